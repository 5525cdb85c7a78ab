"""Claims about patterns that follow a measure: they grow towards danger, and every change can be felt.

Danger is derived from the rules. Along a measure, an alarm that begins at one end makes that end the worse
one; else silence at one end makes the other end worse; else a state of higher priority makes its end worse.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

from haptigraph.inference.procedure import Procedure
from haptigraph.messages import Follow, Pattern
from haptigraph.proof.claims.felt import AMPLITUDE_JND, FREQUENCY_JND, PERIOD_JND
from haptigraph.proof.neighbours import Line, lines_of, nominal_space
from haptigraph.proof.report import Claim, Violation
from haptigraph.proof.scales import Cell

__all__ = ["follow_claims"]

MIN_STEPS = 4
MIN_REACHED = 0.5
JND = {"amplitude": AMPLITUDE_JND, "frequency_hz": FREQUENCY_JND, "rate_hz": PERIOD_JND}


class _Use(NamedTuple):
    """A `follow` table in a state that feels it."""

    state: str
    pattern: Pattern
    follow: Follow
    cells: tuple[Cell, ...]
    """Of the followed measure, in ascending order."""
    lines: list[Line]
    worse: int
    """At which end of its measure the state is worse: 1 at the high one, -1 at the low, 0: undecided."""


def follow_claims(procedure: Procedure) -> list[Claim]:
    """Return the claims about everything that follows a measure; none if nothing does."""
    if not any(pattern.follow for pattern in procedure.patterns):
        return []
    uses = _uses(procedure)
    undecided = [use.state for use in uses if not use.follow.because and not use.worse]
    note = f" (the rules do not say where that is: {', '.join(undecided)})" if undecided else ""
    return [
        Claim(
            "follow grows",
            "what follows a measure grows towards an alarm, else away from silence, else towards the state "
            f"of higher priority{note}",
            tuple(_inverted(uses)),
        ),
        Claim(
            "follow felt",
            f"what follows a measure changes by a noticeable difference, in {MIN_STEPS} steps or more, "
            "where its state is felt",
            tuple(_unnoticed(procedure, uses)),
        ),
    ]


def _uses(procedure: Procedure) -> list[_Use]:
    patterns = {pattern.name: pattern for pattern in procedure.patterns}
    space = nominal_space(procedure)
    at = {scale.name: number for number, scale in enumerate(space.scales)}
    measures = {follow.measure for pattern in procedure.patterns for follow in pattern.follow}
    lines = lines_of(procedure, space, [at[name] for name in measures])
    return [
        _Use(
            *(state.name, pattern, follow, space.scales[number].cells, lines.get(number, [])),
            _worse(procedure, state.name, lines.get(number, [])),
        )
        for state in procedure.states
        for pattern in [patterns[state.feel]]
        for follow in pattern.follow
        for number in [at[follow.measure]]
    ]


def _worse(procedure: Procedure, state: str, lines: list[Line]) -> int:
    """Return at which end of a measure a state is worse; see `_Use.worse`."""
    beyond = {-1: set[str](), 1: set[str]()}
    for line in lines:
        for at, one in line:
            for to, other in line:
                if one == state != other and abs(to - at) == 1:
                    beyond[to - at].add(other)
    kinds = procedure.kinds
    feels = {one.name: one.feel for one in procedure.states}
    silent = {pattern.name for pattern in procedure.patterns if pattern.kind == "off"}
    priority = {one.name: number for number, one in enumerate(procedure.states)}
    votes: list[Callable[[str], int]] = [
        lambda other: int(kinds[other] == "alarm"),
        lambda other: -int(feels[other] in silent),
        lambda other: 1 if priority[other] < priority[state] else -1,
    ]
    for vote in votes:
        sides = {side * vote(other) for side, others in beyond.items() for other in others} - {0}
        if sides:
            return sides.pop() if len(sides) == 1 else 0
    return 0


def _inverted(uses: list[_Use]) -> Iterator[Violation]:
    for use in uses:
        (first, low), (last, high) = use.follow.start, use.follow.end
        grows = 1 if (high - low) * (last - first) > 0 else -1
        if use.follow.because or low == high or use.worse in (0, grows):
            continue
        side = "smaller" if grows == 1 else "larger"
        sentence = (
            f"{use.follow.key} of {use.pattern.name!r} falls as {use.follow.measure} becomes {side}, "
            f"where {use.state!r} becomes worse; swap the numbers of start and end, or give because"
        )
        yield Violation(sentence, f"pattern {use.pattern.name}")


def _unnoticed(procedure: Procedure, uses: list[_Use]) -> Iterator[Violation]:
    for pattern in procedure.patterns:
        for follow in pattern.follow:
            if reason := _too_coarse(follow) or _never_reached(uses, pattern, follow):
                yield Violation(f"{pattern.name!r} {reason}", f"pattern {pattern.name}")


def _too_coarse(follow: Follow) -> str:
    """Return why a follow table changes nothing that is felt; empty if it does."""
    (first, low), (last, high) = follow.start, follow.end
    span = abs(last - first)
    if follow.dead_band * MIN_STEPS > span:
        return (
            f"ignores changes of {follow.measure} up to {follow.dead_band:g}, "
            f"and follows it over {span:g} only; give a dead_band of at most {span / MIN_STEPS:.3g}"
        )
    least = 1 + JND[follow.key]
    if max(low, high) < least * min(low, high) - 1e-9:
        return (
            f"changes its {follow.key} from {low:g} to {high:g} with {follow.measure}, which is not noticed; "
            f"let one be {least:g} times the other or more"
        )
    return ""


def _never_reached(uses: list[_Use], pattern: Pattern, follow: Follow) -> str:
    """Return why most of a follow table is never used; empty if it is."""
    mine = [use for use in uses if use.pattern == pattern and use.follow == follow]
    first, last = sorted((follow.start[0], follow.end[0]))
    cells = {
        use.cells[at].interval for use in mine for line in use.lines for at, name in line if name == use.state
    }
    if not cells:
        return ""
    reached = sum(max(0.0, min(cell.high, last) - max(cell.low, first)) for cell in cells)
    if reached >= MIN_REACHED * (last - first):
        return ""
    low, high = min(cell.low for cell in cells), max(cell.high for cell in cells)
    return (
        f"follows {follow.measure} from {first:g} to {last:g}, but is felt from {low:g} to {high:g}; "
        "move start and end to where it is felt"
    )
