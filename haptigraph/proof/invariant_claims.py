"""The claims a procedure makes of itself: its invariants, each true of every possible graph."""

from collections.abc import Iterator

from haptigraph.inference.claims import Invariant
from haptigraph.messages import UNKNOWN
from haptigraph.proof.report import Claim, Violation
from haptigraph.proof.rules import Cube, cube
from haptigraph.proof.space import World
from haptigraph.proof.subject import Subject

__all__ = ["invariant_claims"]


def invariant_claims(subject: Subject) -> list[Claim]:
    """Return the invariants of a procedure as claims."""
    return [
        Claim("invariant", invariant.name, tuple(_broken(subject, invariant)), _breaking(subject, invariant))
        for invariant in subject.procedure.invariants
    ]


def _first_part(subject: Subject, invariant: Invariant) -> Cube:
    return cube(
        subject.space,
        when=invariant.when,
        unless=invariant.unless,
        present=invariant.present,
        absent=invariant.absent,
    )


def _breaking(subject: Subject, invariant: Invariant) -> tuple[str, ...]:
    """Return the states that break an invariant while they are held before a later rule that fits."""
    states, first_part = subject.procedure.states, _first_part(subject, invariant)
    return tuple(
        state.name
        for number, state in enumerate(states)
        if state.hold_ms
        and not invariant.allows(state.name, state.feel)
        and subject.prover.exists(Cube(), number)
        and any(
            states[later].name != UNKNOWN and subject.prover.exists(first_part, later)
            for later in range(number + 1, len(states))
        )
    )


def _broken(subject: Subject, invariant: Invariant) -> Iterator[Violation]:
    about = f"invariant {invariant.name}"
    space = subject.space
    first_part = _first_part(subject, invariant)
    if not subject.prover.exists(first_part):
        sentence = f"says nothing: {subject.conflict(first_part)} cannot be"
        yield subject.impossible(sentence, about, invariant.when, invariant.present)
        return
    states = subject.procedure.states
    outcomes = [(state.name, state.feel) for state in states]
    silent = next(state.feel for state in states if state.name == UNKNOWN)
    broken: list[tuple[int, int, str, str, World]] = []
    for number, (state, feel) in enumerate([*outcomes, (UNKNOWN, silent)]):
        if invariant.allows(state, feel):
            continue
        world = subject.prover.smallest(first_part, number)
        if world is not None:
            broken.append(((world.mask & space.visible).bit_count(), number, state, feel, world))
    if broken:
        _, _, state, feel, world = min(broken, key=lambda found: found[:2])
        yield subject.violation(f"here the state is {state!r}, which feels {feel!r}", about, world)
