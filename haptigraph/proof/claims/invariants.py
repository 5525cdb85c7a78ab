"""The claims that a procedure makes about itself: its invariants, each true of every possible graph."""

from collections.abc import Iterator
from functools import partial

from haptigraph.inference.claims import Invariant
from haptigraph.inference.procedure import State
from haptigraph.messages import UNKNOWN
from haptigraph.proof.report import Claim, Violation
from haptigraph.proof.rules import Cube, make_cube
from haptigraph.proof.space import World
from haptigraph.proof.subject import Subject

__all__ = ["invariant_claims"]


def invariant_claims(subject: Subject) -> list[Claim]:
    """Return the invariants of a procedure as claims."""
    return [
        Claim(
            "invariant",
            invariant.name,
            tuple(_violations(subject, invariant)),
            subject.held_states(_premise(subject, invariant), partial(_violates, invariant)),
            _waiting_states(subject, invariant),
        )
        for invariant in subject.procedure.invariants
    ]


def _premise(subject: Subject, invariant: Invariant) -> Cube:
    return make_cube(
        subject.space,
        when=invariant.when,
        unless=invariant.unless,
        present=invariant.present,
        absent=invariant.absent,
    )


def _violates(invariant: Invariant, state: State) -> bool:
    return not invariant.allows(state.name, state.feel, state.force)


def _waiting_states(subject: Subject, invariant: Invariant) -> tuple[str, ...]:
    """Return the states while whose graphs wait a later rule violates an invariant."""
    states, premise = subject.procedure.states, _premise(subject, invariant)
    found = []
    for number, state in enumerate(states):
        if state.enter_after_ms:
            rule, others = subject.rules[number], subject.without(number)
            waiting = Cube(premise.require | rule.require, premise.forbid | rule.forbid)
            rest = states[:number] + states[number + 1 :]
            if any(
                _violates(invariant, other) and others.is_satisfiable(waiting, at)
                for at, other in enumerate(rest)
            ):
                found.append(state.name)
    return tuple(found)


def _violations(subject: Subject, invariant: Invariant) -> Iterator[Violation]:
    about = f"invariant {invariant.name}"
    space = subject.space
    premise = _premise(subject, invariant)
    if not subject.prover.is_satisfiable(premise):
        sentence = f"applies to no graph: {subject.conflict(premise)} is impossible"
        yield subject.impossible(sentence, about, invariant.when, invariant.present)
        return
    states = subject.procedure.states
    outcomes = [(state.name, state.feel, state.force) for state in states]
    silent = next(state.feel for state in states if state.name == UNKNOWN)
    found: list[tuple[int, int, str, World]] = []
    for number, (state, feel, forces) in enumerate([*outcomes, (UNKNOWN, silent, ())]):
        if invariant.allows(state, feel, forces):
            continue
        world = subject.prover.smallest_witness(premise, number)
        if world is not None:
            exerts = f" and exerts {', '.join(forces)}" if forces else ""
            sentence = f"here the state is {state!r}, which feels {feel!r}{exerts}"
            found.append(((world.mask & space.visible).bit_count(), number, sentence, world))
    if found:
        _, _, sentence, world = min(found, key=lambda one: one[:2])
        yield subject.violation(sentence, about, world)
