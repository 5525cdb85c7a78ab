"""The scale of one measure: its number line, partitioned into cells by the thresholds of all relations on it.

Relations of one measure depend on each other: where one holds, another must, may or cannot. With `release`
(hysteresis) they depend on the past as well. All pasts are followed; a measure may jump between images.
"""

from collections.abc import Iterable, Mapping
from itertools import chain, combinations

from msgspec import Struct

from haptigraph.graph import Relation, Schema
from haptigraph.proof.intervals import Interval, atoms
from haptigraph.scene.relations import Limits, Measure

__all__ = ["Cell", "Scale", "bits_of", "scales_of"]


class Cell(Struct, frozen=True):
    """An interval on which the same relations hold."""

    interval: Interval
    enter: int
    """Relations that hold whatever the past, one bit each, numbered as in the schema."""
    hold: int
    """Relations that hold if they held before."""
    masks: tuple[int, ...]
    """The sets of relations that can hold together here, regardless of `given`."""

    def after(self, held: int) -> int:
        """Return the relations that hold in the image after one in which `held` did."""
        return self.enter | (self.hold & held)


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
    bounds = {
        bound
        for relation in relations.values()
        for bound in (
            relation.at_most,
            relation.below,
            relation.at_least,
            relation.above,
            relation.release,
        )
        if bound is not None
    }
    cells: list[Cell] = []
    for atom in atoms(
        bounds, Interval(limits.lower, limits.upper, limits.lower > -1e300, limits.upper < 1e300)
    ):
        value = atom.sample()
        enter = sum(1 << number for number, one in relations.items() if one.holds(value))
        hold = sum(1 << number for number, one in relations.items() if one.holds(value, held=True))
        if cells and (cells[-1].enter, cells[-1].hold) == (enter, hold):
            atom = cells.pop().interval.union(atom)
        cells.append(Cell(atom, enter, hold, ()))
    return cells


def _with_reachable_masks(cells: list[Cell], relations: Mapping[int, Relation]) -> tuple[Cell, ...]:
    """Find the sets of relations that can hold together in each cell after any sequence of images.

    A relation with `given` may cease to hold at any image for reasons outside this measure.
    """
    losable = sum(1 << number for number, relation in relations.items() if relation.given)
    reached = {0}
    fresh = [0]
    while fresh:
        held = fresh.pop()
        for cell in cells:
            mask = cell.after(held)
            for lost in _subsets(bits_of(mask & losable)):
                if (left := mask & ~lost) not in reached:
                    reached.add(left)
                    fresh.append(left)
    return tuple(
        Cell(cell.interval, cell.enter, cell.hold, tuple(sorted({cell.after(held) for held in reached})))
        for cell in cells
    )


def _subsets(bits: list[int]) -> Iterable[int]:
    chosen = chain.from_iterable(combinations(bits, size) for size in range(len(bits) + 1))
    return (sum(1 << bit for bit in some) for some in chosen)
