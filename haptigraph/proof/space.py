"""All graphs that are possible under a schema: the entities that are present, and the cell of each measure.

Thresholds, margins, `given`, `fixed`, `visible_with`, `only_with` and geometric limits decide what is
possible. Neither motion is modelled nor that one tip decides several standard deviations: any graph may
follow any other, and the standard deviation of every measure is free.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, combinations, product
from math import prod

from msgspec import Struct

from haptigraph.graph import Node, SceneGraph, Schema, Triplet
from haptigraph.proof.scales import Cell, holdings_at, scales_of
from haptigraph.scene.relations import MEASURES, Measure

__all__ = ["CellState", "Space", "World"]


class CellState(Struct, frozen=True):
    """The cell of one measure, and which of its relations hold there, regardless of `given`."""

    cell: Cell
    mask: int


class World(Struct, frozen=True):
    """One possible graph, and the cells of the measures that produce it."""

    mask: int
    """Edges and entities, one bit each: the graph as rules see it."""
    cell_states: tuple[CellState | None, ...]
    """One per scale; None where the measure is undefined."""


class Space:
    """The possible graphs of a schema.

    Bits are numbered as in the rule engine: relations first, then entities. Entities follow that a measure
    requires but the schema does not declare: nothing is known about them, so they may be absent.

    Args:
        schema: Of a checked procedure.
        measures: The geometric limits of the measures.
    """

    def __init__(self, schema: Schema, measures: Mapping[str, Measure] = MEASURES) -> None:
        self.schema = schema
        self.scales = scales_of(schema, measures)
        self.edge_bits = {relation.names: 1 << number for number, relation in enumerate(schema.relations)}
        names = [entity.name for entity in schema.entities]
        self.undeclared = tuple(
            dict.fromkeys(name for scale in self.scales for name in scale.requires if name not in names)
        )
        count = len(schema.relations)
        self.entity_bits = {name: 1 << (count + at) for at, name in enumerate((*names, *self.undeclared))}
        self.edges = (1 << count) - 1
        self.visible = (1 << (count + len(names))) - 1
        """The bits that a graph shows: all except undeclared entities."""
        self.fixed, self.clusters = self._clusters()
        self.only_with = [
            (self.entity_bits[entity.name], self.entity_bits[entity.only_with])
            for entity in schema.entities
            if entity.only_with
        ]
        """Pairs of bits: the first entity is never present without the second."""
        at = {
            (scale.measure, scale.subject, scale.object): number for number, scale in enumerate(self.scales)
        }
        above = [(scale.limits.never_above, scale.subject, scale.object) for scale in self.scales]
        self.never_above = {number: at[key] for number, key in enumerate(above) if key in at}
        """For each scale: the scale that it never exceeds."""

    def entity_sets(self) -> Iterator[int]:
        """Yield every set of entities that can be present together, as bits, smallest first."""
        yield 0
        choices = chain.from_iterable(
            combinations(self.clusters, size) for size in range(len(self.clusters) + 1)
        )
        for some in choices:
            bits = self.fixed | sum(some)
            if bits and all(bits & other for one, other in self.only_with if bits & one):
                yield bits

    def toggled(self, present: int, cluster: int) -> int:
        """Return a set of entities in which a cluster has appeared or vanished, with what that entails."""
        appears, toggled = not present & cluster, present ^ cluster
        for _ in self.only_with:
            for one, other in self.only_with:
                if toggled & one and not toggled & other:
                    changed = other if appears else one
                    toggled ^= next((bits for bits in self.clusters if bits & changed), changed)
        return toggled

    def measured(self, present: int) -> list[bool]:
        """Return for every scale whether its measure is defined for a set of entities."""
        return [all(present & self.entity_bits[name] for name in scale.requires) for scale in self.scales]

    def count(self) -> int:
        """Count the worlds, including those that geometry excludes."""
        sizes = [sum(len(cell.masks) for cell in scale.cells) for scale in self.scales]
        return sum(
            prod(size for size, is_defined in zip(sizes, self.measured(present), strict=True) if is_defined)
            for present in self.entity_sets()
        )

    def worlds(self) -> Iterator[World]:
        """Yield every possible world."""
        choices = [
            [
                CellState(cell, mask)
                for cell in sorted(scale.cells, key=lambda cell: len({*chain(*cell.holdings)}))
                for mask in sorted(cell.masks, key=lambda mask: mask != cell.enter)
            ]  # first those that need neither hysteresis nor uncertainty
            for scale in self.scales
        ]
        for present in self.entity_sets():
            measured = self.measured(present)
            options = [
                some if is_defined else [None] for some, is_defined in zip(choices, measured, strict=True)
            ]
            for cell_states in product(*options):
                if self.is_consistent(cell_states):
                    yield self.world(present, cell_states)

    def world(self, present: int, cell_states: tuple[CellState | None, ...]) -> World:
        """Return the world of a set of entities and the cells of their measures."""
        raw = sum(state.mask for state in cell_states if state is not None)
        return World(present | self.close(raw), cell_states)

    def close(self, raw: int) -> int:
        """Remove the relations whose `given` do not hold."""
        edges = 0
        for number, relation in enumerate(self.schema.relations):
            if raw >> number & 1 and all(edges & self.edge_bits[names] for names in relation.given):
                edges |= 1 << number
        return edges

    def is_consistent(self, cell_states: Sequence[CellState | None]) -> bool:
        """Return whether the geometric limits allow these cells at once."""
        intervals = [state.cell.interval if state else None for state in cell_states]
        for small, large in self.never_above.items():
            lower, upper = intervals[small], intervals[large]
            if lower is not None and upper is not None and not lower.can_be_at_most(upper):
                return False
        return True

    def measures(self, world: World) -> dict[str, float]:
        """Return example values of the measures that produce a world."""
        intervals = {number: state.cell.interval for number, state in enumerate(world.cell_states) if state}
        values = {number: interval.sample() for number, interval in intervals.items()}
        for small, large in self.never_above.items():
            if small in values and large in values and values[small] > values[large]:
                values[small] = values[large] = intervals[small].intersection(intervals[large]).sample()
        return {self.scales[number].name: value for number, value in values.items()}

    def sds(self, world: World, measures: Mapping[str, float]) -> dict[str, float]:
        """Return example standard deviations that produce a world with these measures."""
        sds = {}
        for scale, state in zip(self.scales, world.cell_states, strict=True):
            relations = {number: self.schema.relations[number] for number in scale.relations}
            if state is None or not any(relation.margin_sd for relation in relations.values()):
                continue
            able = [
                (holding.enter != state.mask, sd)
                for sd, holding in holdings_at(relations, measures[scale.name]).items()
                if holding.after(state.mask) == state.mask
            ]
            sds[scale.name] = float(min(able, key=lambda one: one[0])[1])
        return sds

    def graph(self, world: World) -> SceneGraph:
        """Return a world as the scene graph that a builder would make of it."""
        measures = self.measures(world)
        return SceneGraph(
            stamp_ns=0,
            nodes=tuple(
                Node(entity.name, entity.name, entity.group)
                for entity in self.schema.entities
                if world.mask & self.entity_bits[entity.name]
            ),
            edges=tuple(Triplet(*names) for names, bit in self.edge_bits.items() if world.mask & bit),
            measures=measures,
            sds=self.sds(world, measures),
        )

    def mask(self, graph: SceneGraph) -> int:
        """Return a scene graph as bits."""
        category = {node.id: node.category for node in graph.nodes}
        mask = 0
        for name in category.values():
            mask |= self.entity_bits.get(name, 0)
        for edge in graph.edges:
            mask |= self.edge_bits.get((category[edge.subject], edge.predicate, category[edge.object]), 0)
        return mask

    def _clusters(self) -> tuple[int, list[int]]:
        """Return the entities that are always present, and the sets that appear and vanish together."""
        fixed, lead = 0, dict[str, str]()
        together: dict[str, int] = {}
        for entity in self.schema.entities:
            lead[entity.name] = lead[entity.visible_with] if entity.visible_with else entity.name
            together[lead[entity.name]] = together.get(lead[entity.name], 0) | self.entity_bits[entity.name]
            if entity.fixed:
                fixed |= self.entity_bits[entity.name]
        free = [bits for bits in together.values() if not bits & fixed]
        always = sum(bits for bits in together.values() if bits & fixed)
        return always, [*free, *(self.entity_bits[name] for name in self.undeclared)]
