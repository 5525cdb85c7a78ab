"""The scale of one measure: its number line, partitioned into cells by the thresholds of all relations on it.

Relations of one measure depend on each other: where one holds, another must, may or cannot. With `release`
(hysteresis) they depend on the past as well, and with `margin_sd` on the standard deviation of the measure.
All pasts and all standard deviations are followed; both measure and standard deviation may jump between
images.
"""

from collections.abc import Iterable, Mapping
from fractions import Fraction
from itertools import chain, combinations, pairwise
from math import isfinite
from typing import NamedTuple

from msgspec import Struct

from haptigraph.graph import Relation, Schema
from haptigraph.proof.intervals import Interval, atoms
from haptigraph.scene.relations import Limits, Measure

__all__ = ["Cell", "Holding", "Scale", "bits_of", "holdings_at", "scales_of"]


class Holding(NamedTuple):
    """What holds at one value and one standard deviation of a measure, one bit a relation of the schema."""

    enter: int
    """Relations that hold whatever the past."""
    hold: int
    """Relations that hold if they held before."""

    def after(self, held: int) -> int:
        """Return the relations that hold in the image after one in which `held` did."""
        return self.enter | (self.hold & held)


class Cell(Struct, frozen=True):
    """An interval on which the same relations hold."""

    interval: Interval
    holdings: tuple[Holding, ...]
    """One for each standard deviation that makes a difference, first that of 0."""
    masks: tuple[int, ...]
    """The sets of relations that can hold together here, regardless of `given`."""

    @property
    def enter(self) -> int:
        """Relations that hold whatever the past and the standard deviation."""
        return self.holdings[0].enter

    def after(self, held: int) -> int:
        """Return what holds in the image after one in which `held` did, if nothing is uncertain."""
        return self.holdings[0].after(held)


class Scale(Struct, frozen=True):
    """One measure between one subject and one object, and all relations that it decides."""

    name: str
    """As graphs carry it: "theta_deg"."""
    measure: str
    """As procedures name it."""
    subject: str
    object: str
    limits: Limits
    relations: tuple[int, ...]
    """Indices in the schema."""
    cells: tuple[Cell, ...]

    @property
    def requires(self) -> tuple[str, ...]:
        """Entities without which the measure is undefined."""
        return (self.subject, self.object, *self.limits.requires)

    @property
    def bits(self) -> int:
        """The bits of all its relations."""
        return sum(1 << number for number in self.relations)

    def cell_at(self, value: float) -> Cell:
        """Return the cell that contains a value; the nearest one if it is beyond the geometric limits."""
        return min(
            self.cells, key=lambda cell: (value not in cell.interval, abs(cell.interval.offset_from(value)))
        )


def holdings_at(relations: Mapping[int, Relation], value: float) -> dict[Fraction, Holding]:
    """Return what holds at a value, by standard deviation: those at which it changes, and one in between.

    Args:
        relations: Those of one measure, by their index in the schema.
        value: The measure.
    """
    changes = {Fraction(0)}
    for relation in relations.values():
        if relation.margin_sd:
            changes |= {
                Fraction(abs(value - bound)) / Fraction(relation.margin_sd) for bound in _bounds(relation)
            }
    ordered = sorted(changes)
    between = [(low + high) / 2 for low, high in pairwise(ordered)]
    beyond = [ordered[-1] + 1] if any(relation.margin_sd for relation in relations.values()) else []
    return {sd: _holding(relations, value, sd) for sd in (ordered[0], *between, *beyond, *ordered[1:])}


def bits_of(mask: int) -> list[int]:
    """Return the indices of the bits that are set."""
    return [number for number in range(mask.bit_length()) if mask >> number & 1]


def scales_of(schema: Schema, measures: Mapping[str, Measure]) -> tuple[Scale, ...]:
    """Return the scales of a schema, in the order of their first relations."""
    groups: dict[str, list[int]] = {}
    for number, relation in enumerate(schema.relations):
        groups.setdefault(schema.measure_name(relation), []).append(number)
    return tuple(_scale(schema, name, numbers, measures) for name, numbers in groups.items())


def _scale(schema: Schema, name: str, numbers: list[int], measures: Mapping[str, Measure]) -> Scale:
    first = schema.relations[numbers[0]]
    shapes = (schema.entity(first.subject).geometry, schema.entity(first.object).geometry)
    limits = measures[first.measure].shapes[shapes]
    relations = {number: schema.relations[number] for number in numbers}
    return Scale(
        name=name,
        measure=first.measure,
        subject=first.subject,
        object=first.object,
        limits=limits,
        relations=tuple(numbers),
        cells=_with_reachable_masks(_cells(relations, limits), relations),
    )


def _cells(relations: Mapping[int, Relation], limits: Limits) -> list[Cell]:
    """Partition the range of a measure at every threshold; merge cells with the same relations."""
    bounds = {bound for relation in relations.values() for bound in _bounds(relation)}
    bounds |= _crossings(relations)
    cells: list[Cell] = []
    for atom in atoms(
        bounds, Interval(limits.lower, limits.upper, limits.lower > -1e300, limits.upper < 1e300)
    ):
        holdings = tuple(dict.fromkeys(holdings_at(relations, atom.sample()).values()))
        if cells and _are_same(cells[-1].holdings, holdings):
            atom = cells.pop().interval.union(atom)
        cells.append(Cell(atom, holdings, ()))
    return cells


def _are_same(some: tuple[Holding, ...], others: tuple[Holding, ...]) -> bool:
    return some[0] == others[0] and {*some} == {*others}


def _bounds(relation: Relation) -> list[float]:
    bounds = relation.at_most, relation.below, relation.at_least, relation.above, relation.release
    return [bound for bound in bounds if bound is not None and isfinite(bound)]


def _holding(relations: Mapping[int, Relation], value: float, sd: Fraction) -> Holding:
    enter = hold = 0
    for number, relation in relations.items():
        margin = Fraction(relation.margin_sd) * sd
        enter |= relation.holds(value, margin=margin) << number
        hold |= relation.holds(value, held=True, margin=margin) << number
    return Holding(enter, hold)


def _crossings(relations: Mapping[int, Relation]) -> set[float]:
    """Return the values at which two relations begin to hold at the same standard deviation.

    On either side, one or the other begins first. A bound begins to be met at |value - bound| / margin_sd.
    """
    margins = [
        (Fraction(bound), Fraction(relation.margin_sd))
        for relation in relations.values()
        if relation.margin_sd
        for bound in _bounds(relation)
    ]
    found = set()
    for (one, by), (other, by_other) in combinations(margins, 2):
        found.add((by_other * one + by * other) / (by + by_other))
        if by != by_other:
            found.add((by_other * one - by * other) / (by_other - by))
    return {float(value) for value in found}


def _with_reachable_masks(cells: list[Cell], relations: Mapping[int, Relation]) -> tuple[Cell, ...]:
    """Find the sets of relations that can hold together in each cell after any sequence of images.

    A relation with `given` may cease to hold at any image for reasons outside this measure.
    """
    losable = sum(1 << number for number, relation in relations.items() if relation.given)
    reached = {0}
    fresh = [0]
    while fresh:
        held = fresh.pop()
        for holding in {holding for cell in cells for holding in cell.holdings}:
            mask = holding.after(held)
            for lost in _subsets(bits_of(mask & losable)):
                if (left := mask & ~lost) not in reached:
                    reached.add(left)
                    fresh.append(left)
    return tuple(
        Cell(
            cell.interval,
            cell.holdings,
            tuple(sorted({holding.after(held) for holding in cell.holdings for held in reached})),
        )
        for cell in cells
    )


def _subsets(bits: list[int]) -> Iterable[int]:
    chosen = chain.from_iterable(combinations(bits, size) for size in range(len(bits) + 1))
    return (sum(1 << bit for bit in some) for some in chosen)
