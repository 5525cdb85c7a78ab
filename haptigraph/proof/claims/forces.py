"""Claims about force: nothing pushes the hand while the tip is not seen, and every force is used."""

from collections.abc import Iterator

from haptigraph.inference.forces import TIP
from haptigraph.inference.procedure import Procedure
from haptigraph.proof.report import Claim, Violation
from haptigraph.proof.rules import Cube, make_cube
from haptigraph.proof.subject import Subject

__all__ = ["force_claims"]


def force_claims(subject: Subject) -> list[Claim]:
    """Return the claims about the force fields of a procedure; none if it has none."""
    procedure = subject.procedure
    if not procedure.forces:
        return []
    return [
        Claim(
            "force unseen",
            f"no state that exerts a force fits a graph without {TIP}",
            tuple(_blind(subject)),
            subject.held_states(_blind_graphs(subject), lambda state: bool(state.force)),
        ),
        Claim("force used", "some state exerts every force", tuple(_unused(procedure))),
    ]


def _blind_graphs(subject: Subject) -> Cube:
    return make_cube(subject.space, absent=[TIP])


def _blind(subject: Subject) -> Iterator[Violation]:
    blind = _blind_graphs(subject)
    for number, state in enumerate(subject.procedure.states):
        world = subject.prover.smallest_witness(blind, number) if state.force else None
        if world is not None:
            sentence = (
                f"{state.name!r} exerts {', '.join(state.force)} although no tip is seen; "
                f"require a relation of {TIP}, or remove the force"
            )
            yield subject.violation(sentence, f"state {state.name}", world)


def _unused(procedure: Procedure) -> Iterator[Violation]:
    used = {name for state in procedure.states for name in state.force}
    for field in procedure.forces:
        if field.name not in used:
            yield Violation(f"no state exerts {field.name!r}", f"force {field.name}")
