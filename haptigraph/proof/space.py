"""Every graph that is possible under a schema: which entities are there, in which cell each measure lies.

Thresholds, `given`, `fixed`, `seen_with` and what geometry always says decide what is possible; nothing is
known of how things move, so anything may follow anything. Knows no rule.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, combinations, product
from math import prod

from msgspec import Struct

from haptigraph.graph import Node, SceneGraph, Schema, Triplet
from haptigraph.proof.scales import Cell, scales_of
from haptigraph.scene.relations import MEASURES, Measure

__all__ = ["Place", "Space", "World"]


class Place(Struct, frozen=True):
    """Where one measure lies, and which of its relations hold there, `given` left aside."""

    cell: Cell
    mask: int


class World(Struct, frozen=True):
    """One possible graph, and where the measures lie that make it."""

    mask: int
    """Edges and entities, one bit each: the graph as rules see it."""
    places: tuple[Place | None, ...]
    """Of every scale; None where there is no such measure."""


class Space:
    """What may be seen under a schema.

    Bits are numbered as in the rule engine: relations first, then entities. Behind them come entities that a
    measure needs but the schema does not name: nothing is known of them, so they may be absent.

    Args:
        schema: Of a checked procedure.
        measures: What geometry always says of the measures.
    """

    def __init__(self, schema: Schema, measures: Mapping[str, Measure] = MEASURES) -> None:
        self.schema = schema
        self.scales = scales_of(schema, measures)
        self.edge_bits = {relation.names: 1 << number for number, relation in enumerate(schema.relations)}
        names = [entity.name for entity in schema.entities]
        self.unnamed = tuple(
            dict.fromkeys(name for scale in self.scales for name in scale.needs if name not in names)
        )
        count = len(schema.relations)
        self.entity_bits = {name: 1 << (count + at) for at, name in enumerate((*names, *self.unnamed))}
        self.edges = (1 << count) - 1
        self.visible = (1 << (count + len(names))) - 1
        """What a graph shows: all but the entities that the schema does not name."""
        self.fixed, self.clusters = self._clusters()
        at = {
            (scale.measure, scale.subject, scale.object): number for number, scale in enumerate(self.scales)
        }
        above = [(scale.always.never_above, scale.subject, scale.object) for scale in self.scales]
        self.never_above = {number: at[key] for number, key in enumerate(above) if key in at}
        """By scale: the scale that it never exceeds."""

    def presences(self) -> Iterator[int]:
        """Yield every set of entities that may be there, as bits, smallest first."""
        yield 0
        choices = chain.from_iterable(
            combinations(self.clusters, size) for size in range(len(self.clusters) + 1)
        )
        for some in choices:
            if bits := self.fixed | sum(some):
                yield bits

    def measured(self, present: int) -> list[bool]:
        """Tell of every scale whether its measure is there."""
        return [all(present & self.entity_bits[name] for name in scale.needs) for scale in self.scales]

    def count(self) -> int:
        """Count the worlds, those included that geometry then rules out."""
        sizes = [sum(len(cell.masks) for cell in scale.cells) for scale in self.scales]
        return sum(
            prod(size for size, there in zip(sizes, self.measured(present), strict=True) if there)
            for present in self.presences()
        )

    def worlds(self) -> Iterator[World]:
        """Yield every possible world."""
        choices = [
            [
                Place(cell, mask)
                for cell in sorted(scale.cells, key=lambda cell: cell.enter != cell.hold)  # plain ones first
                for mask in cell.masks
            ]
            for scale in self.scales
        ]
        for present in self.presences():
            there = self.measured(present)
            options = [some if here else [None] for some, here in zip(choices, there, strict=True)]
            for places in product(*options):
                if self.agree(places):
                    yield self.world(present, places)

    def world(self, present: int, places: tuple[Place | None, ...]) -> World:
        """Return the world of some entities and places."""
        raw = sum(place.mask for place in places if place is not None)
        return World(present | self.close(raw), places)

    def close(self, raw: int) -> int:
        """Take away the relations whose `given` do not hold."""
        edges = 0
        for number, relation in enumerate(self.schema.relations):
            if raw >> number & 1 and all(edges & self.edge_bits[names] for names in relation.given):
                edges |= 1 << number
        return edges

    def agree(self, places: Sequence[Place | None]) -> bool:
        """Tell whether measures can lie so at once, by what geometry always says of two of them."""
        intervals = [place.cell.interval if place else None for place in places]
        for small, large in self.never_above.items():
            lower, upper = intervals[small], intervals[large]
            if lower is not None and upper is not None and not lower.reaches(upper):
                return False
        return True

    def measures(self, world: World) -> dict[str, float]:
        """Return example values that make a world what it is."""
        intervals = {number: place.cell.interval for number, place in enumerate(world.places) if place}
        values = {number: interval.sample() for number, interval in intervals.items()}
        for small, large in self.never_above.items():
            if small in values and large in values and values[small] > values[large]:
                values[small] = values[large] = intervals[small].met(intervals[large]).sample()
        return {self.scales[number].name: value for number, value in values.items()}

    def graph(self, world: World) -> SceneGraph:
        """Return a world as the scene graph that a builder would make of it."""
        return SceneGraph(
            stamp_ns=0,
            nodes=tuple(
                Node(entity.name, entity.name, entity.group)
                for entity in self.schema.entities
                if world.mask & self.entity_bits[entity.name]
            ),
            edges=tuple(Triplet(*names) for names, bit in self.edge_bits.items() if world.mask & bit),
            measures=self.measures(world),
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
        """Return the entities that are always there, and the sets that come and go together."""
        fixed, lead = 0, dict[str, str]()
        together: dict[str, int] = {}
        for entity in self.schema.entities:
            lead[entity.name] = lead[entity.seen_with] if entity.seen_with else entity.name
            together[lead[entity.name]] = together.get(lead[entity.name], 0) | self.entity_bits[entity.name]
            if entity.fixed:
                fixed |= self.entity_bits[entity.name]
        free = [bits for bits in together.values() if not bits & fixed]
        always = sum(bits for bits in together.values() if bits & fixed)
        return always, [*free, *(self.entity_bits[name] for name in self.unnamed)]
