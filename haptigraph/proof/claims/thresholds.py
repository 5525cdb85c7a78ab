"""Claims about thresholds: relations on the same measure partition its number line without overlap and gap.

A measure with a single relation is not partitioned: the relation holds or it does not.
"""

from collections.abc import Iterator
from itertools import combinations

from haptigraph.graph import Triplet
from haptigraph.inference.claims import Gap
from haptigraph.proof.intervals import Interval
from haptigraph.proof.report import Claim, Violation
from haptigraph.proof.rules import Cube
from haptigraph.proof.scales import Cell, Scale
from haptigraph.proof.space import CellState, World
from haptigraph.proof.subject import Subject, bounds_of

__all__ = ["threshold_claims"]


def threshold_claims(subject: Subject) -> list[Claim]:
    """Return the claims about the thresholds of a procedure."""
    return [
        Claim("exclusive", "relations of one measure never hold at once", tuple(_overlaps(subject))),
        Claim("gapless", "relations of one measure leave no value out", tuple(_gaps(subject))),
    ]


def _overlaps(subject: Subject) -> Iterator[Violation]:
    relations = subject.procedure.schema.relations
    allowed = {frozenset(overlap.relations) for overlap in subject.procedure.overlaps}
    found = set()
    for scale in subject.space.scales:
        for one, other in combinations(scale.relations, 2):
            world = subject.prover.smallest_witness(Cube(require=1 << one | 1 << other))
            pair = frozenset((relations[one].names, relations[other].names))
            if world is None:
                continue
            found.add(pair)
            if pair not in allowed:
                first, second = (Triplet(*relations[number].names) for number in (one, other))
                sentence = (
                    f"{first} and {second} hold at once; move a threshold, or declare an [[overlap]]; "
                    "here the state is {state}"
                )
                yield subject.violation(sentence, f"relation {second}", world)
    for overlap in subject.procedure.overlaps:
        if frozenset(overlap.relations) not in found:
            first, second = (Triplet(*names) for names in overlap.relations)
            yield subject.impossible(
                f"[[overlap]] of {first} and {second}: they never hold at once, or share no measure",
                "overlap",
                overlap.relations,
            )


def _gaps(subject: Subject) -> Iterator[Violation]:
    is_confirmed = {gap: False for gap in subject.procedure.gaps}
    for scale in subject.space.scales:
        found = _uncovered(scale) if len(scale.relations) > 1 else []
        for interval, cell in found:
            declared = [
                gap for gap in is_confirmed if gap.measure == scale.name and _is_same(gap, interval, scale)
            ]
            is_confirmed |= dict.fromkeys(declared, True)
            if declared:
                continue
            names = " nor ".join(
                str(Triplet(*subject.procedure.schema.relations[at].names)) for at in scale.relations
            )
            sentence = (
                f"where {interval.describe(scale.name)}, neither {names} holds; move a threshold, or declare "
                "a [[gap]]; here the state is {state}"
            )
            yield subject.violation(sentence, f"measure {scale.name}", _world_at(subject, scale, cell))
    for gap, is_gap in is_confirmed.items():
        if not is_gap:
            condition = bounds_of(gap).describe(gap.measure)
            yield Violation(
                f"[[gap]] {condition}: the relations do not leave out exactly these values", "gap"
            )


def _uncovered(scale: Scale) -> list[tuple[Interval, Cell]]:
    """Return the intervals on which no relation holds, or only because it held before."""
    found: list[tuple[Interval, Cell]] = []
    is_open = False
    for cell in scale.cells:
        if cell.enter:
            is_open = False
        elif is_open:
            interval, first = found.pop()
            found.append((interval.union(cell.interval), first))
        else:
            found.append((cell.interval, cell))
            is_open = True
    return found


def _is_same(gap: Gap, interval: Interval, scale: Scale) -> bool:
    """Return whether a declared gap equals this interval, within the geometric limits of the measure."""
    declared, whole = bounds_of(gap), scale.cells[0].interval.union(scale.cells[-1].interval)
    overlaps = declared.can_be_at_most(whole) and whole.can_be_at_most(declared)
    return overlaps and declared.intersection(whole) == interval


def _world_at(subject: Subject, scale: Scale, cell: Cell) -> World:
    """Return a small world in which a measure is in a cell and none of its relations holds."""
    space = subject.space
    at = space.scales.index(scale)
    present = next(present for present in space.entity_sets() if space.measured(present)[at])
    cell_states: list[CellState | None] = [None] * len(space.scales)
    cell_states[at] = CellState(cell, 0)
    for number, is_defined in enumerate(space.measured(present)):
        if not is_defined or number == at:
            continue
        options = [CellState(some, mask) for some in space.scales[number].cells for mask in some.masks]
        for option in sorted(options, key=lambda option: option.mask.bit_count()):
            cell_states[number] = option
            if space.is_consistent(cell_states):
                break
    return space.world(present, tuple(cell_states))
