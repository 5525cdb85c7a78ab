"""Claims about thresholds: relations that share a measure cut its number line without overlap and gap.

A measure with one relation is no such cut: there the relation holds or does not.
"""

from collections.abc import Iterator
from itertools import combinations

from haptigraph.graph import Triplet
from haptigraph.inference.claims import Gap
from haptigraph.proof.intervals import Interval
from haptigraph.proof.report import Claim, Violation
from haptigraph.proof.rules import Cube
from haptigraph.proof.scales import Cell, Scale
from haptigraph.proof.space import Place, World
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
            world = subject.prover.smallest(Cube(require=1 << one | 1 << other))
            pair = frozenset((relations[one].names, relations[other].names))
            if world is None:
                continue
            found.add(pair)
            if pair not in allowed:
                first, second = (Triplet(*relations[number].names) for number in (one, other))
                sentence = (
                    f"{first} and {second} hold at once; move a threshold, or say so with [[overlap]]; "
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
    left_out = {gap: False for gap in subject.procedure.gaps}
    for scale in subject.space.scales:
        found = _uncovered(scale) if len(scale.relations) > 1 else []
        for interval, cell in found:
            declared = [gap for gap in left_out if gap.measure == scale.name and _same(gap, interval, scale)]
            left_out |= dict.fromkeys(declared, True)
            if declared:
                continue
            names = " nor ".join(
                str(Triplet(*subject.procedure.schema.relations[at].names)) for at in scale.relations
            )
            sentence = (
                f"where {interval.said(scale.name)}, neither {names} holds; move a threshold, or say so with "
                "[[gap]]; here the state is {state}"
            )
            yield subject.violation(sentence, f"measure {scale.name}", _world_at(subject, scale, cell))
    for gap, is_one in left_out.items():
        if not is_one:
            told = bounds_of(gap).said(gap.measure)
            yield Violation(f"[[gap]] {told}: this is not exactly what the relations leave out", "gap")


def _uncovered(scale: Scale) -> list[tuple[Interval, Cell]]:
    """Return the stretches in which a relation may hold only because it held before, or none at all."""
    found: list[tuple[Interval, Cell]] = []
    open_end = False
    for cell in scale.cells:
        if cell.enter:
            open_end = False
        elif open_end:
            interval, first = found.pop()
            found.append((interval.joined(cell.interval), first))
        else:
            found.append((cell.interval, cell))
            open_end = True
    return found


def _same(gap: Gap, interval: Interval, scale: Scale) -> bool:
    """Tell whether a declared gap is just this stretch, as far as geometry lets the measure go."""
    declared, whole = bounds_of(gap), scale.cells[0].interval.joined(scale.cells[-1].interval)
    return declared.reaches(whole) and whole.reaches(declared) and declared.met(whole) == interval


def _world_at(subject: Subject, scale: Scale, cell: Cell) -> World:
    """Return a small world in which a measure lies in a cell where nothing holds."""
    space = subject.space
    at = space.scales.index(scale)
    present = next(present for present in space.presences() if space.measured(present)[at])
    places: list[Place | None] = [None] * len(space.scales)
    places[at] = Place(cell, 0)
    for number, here in enumerate(space.measured(present)):
        if not here or number == at:
            continue
        options = [Place(some, mask) for some in space.scales[number].cells for mask in some.masks]
        for place in sorted(options, key=lambda option: option.mask.bit_count()):
            places[number] = place
            if space.agree(places):
                break
    return space.world(present, tuple(places))
