"""Claims about time: no hold delays an alarm; temporal claims agree with the rules and with each other."""

from collections.abc import Iterator
from itertools import combinations

from haptigraph.inference.claims import Temporal
from haptigraph.messages import UNKNOWN
from haptigraph.proof.report import Claim, Violation
from haptigraph.proof.rules import Cube, make_cube
from haptigraph.proof.subject import Subject

__all__ = ["time_claims"]


def time_claims(subject: Subject) -> list[Claim]:
    """Return the claims about holds, about states that must last to be entered, and about temporal claims."""
    return [
        Claim("prompt", "no state that is held delays an alarm", tuple(_delays(subject))),
        Claim("waiting", "while a state waits to be entered, another rule fits", tuple(_unfit(subject))),
        Claim(
            "consistent",
            "temporal claims can be kept: they agree with the rules and with each other",
            (*_contradictions(subject), *_against_rules(subject), *_against_holds(subject)),
        ),
    ]


def _delays(subject: Subject) -> Iterator[Violation]:
    states, kinds = subject.procedure.states, subject.procedure.kinds
    for number, state in enumerate(states):
        if not state.hold_ms or kinds[state.name] == "alarm":
            continue
        for later in range(number + 1, len(states)):
            alarm = states[later].name
            if kinds[alarm] != "alarm" or alarm in state.may_delay:
                continue
            world = subject.prover.smallest_witness(Cube(), later)
            if world is not None:
                sentence = (
                    f"{state.name} is held for {state.hold_ms:g} ms, which delays {alarm}, an alarm, here; "
                    f"remove hold_ms, put {alarm} first, or declare may_delay"
                )
                yield subject.violation(sentence, f"state {state.name}", world)


def _unfit(subject: Subject) -> Iterator[Violation]:
    """Yield states whose graphs fit no later rule, so that nothing is known while they wait."""
    for number, state in enumerate(subject.procedure.states):
        if state.enter_after_ms:
            others = subject.without(number)
            world = others.smallest_witness(subject.rules[number], len(subject.rules) - 1)
            if world is not None:
                sentence = (
                    f"{state.name} waits for {state.enter_after_ms:g} ms; meanwhile no other rule fits here"
                )
                yield subject.violation(sentence, f"state {state.name}", world)


def _premise(subject: Subject, *claims: Temporal) -> Cube:
    """Return the graphs in which the premises of all claims hold."""
    require = forbid = 0
    for one in claims:
        cube = make_cube(
            subject.space, when=one.when, unless=one.unless, present=one.present, absent=one.absent
        )
        require, forbid = require | cube.require, forbid | cube.forbid
    return Cube(require, forbid)


def _responses(subject: Subject) -> list[Temporal]:
    return [claim for claim in subject.procedure.temporal if claim.within_ms is not None]


def _contradictions(subject: Subject) -> Iterator[Violation]:
    for one, other in combinations(_responses(subject), 2):
        if not {*one.feels} & {*other.feels}:
            world = subject.prover.smallest_witness(_premise(subject, one, other))
            if world is not None:
                sentence = (
                    f"{one.name!r} wants {' or '.join(one.feels)}, {other.name!r} wants "
                    f"{' or '.join(other.feels)} in this graph"
                )
                yield subject.violation(sentence, f"temporal {other.name}", world)


def _against_rules(subject: Subject) -> Iterator[Violation]:
    states = subject.procedure.states
    for claim in _responses(subject):
        about, premise = f"temporal {claim.name}", _premise(subject, claim)
        if not subject.prover.is_satisfiable(premise):
            sentence = f"applies to no graph: {subject.conflict(premise)} is impossible"
            yield subject.impossible(sentence, about, claim.when, claim.present)
        for number, state in enumerate(states):
            if state.feel in claim.feels:
                continue
            world = subject.prover.smallest_witness(premise, number)
            if world is not None:
                wants = " or ".join(claim.feels)
                sentence = f"{claim.name!r} wants {wants}; here {{state}} feels {state.feel!r}"
                yield subject.violation(sentence, about, world)
                break


def _against_holds(subject: Subject) -> Iterator[Violation]:
    """Yield claims that a held state breaks, because it outlasts its graph by more than the claim allows."""
    states = subject.procedure.states
    for claim in _responses(subject):
        premise = _premise(subject, claim)
        for number, state in enumerate(states):
            if state.feel in claim.feels or state.hold_ms <= (claim.within_ms or 0.0):
                continue
            for later in range(number + 1, len(states)):
                world = subject.prover.smallest_witness(premise, later)
                if world is not None and states[later].name != UNKNOWN:
                    sentence = (
                        f"{claim.name!r} allows {claim.within_ms:g} ms, but {state.name}, which feels "
                        f"{state.feel!r}, may be held for {state.hold_ms:g} ms in this graph"
                    )
                    yield subject.violation(sentence, f"temporal {claim.name}", world)
                    break
