"""The surgical scene graph G = (V, E, O, R, phi) of the paper, section II-C, and its schema.

V are nodes, O entity categories, R predicates, E a set of <subject, predicate, object> triplets, phi the
category of a node. A graph also carries the measures that decided its edges.
"""

from collections.abc import Mapping
from fractions import Fraction
from math import inf
from typing import TYPE_CHECKING, Annotated, ClassVar, TypeAlias

import msgspec
from msgspec import Meta, Struct
from msgspec.structs import replace

from haptigraph.display import ShownAsSvg, view
from haptigraph.errors import MissingExtra

if TYPE_CHECKING:
    import networkx
    from matplotlib.figure import Figure

__all__ = ["Entity", "GraphDiff", "Names", "Node", "Relation", "SceneGraph", "Schema", "Triplet"]


Names: TypeAlias = tuple[str, str, str]
"""(subject, predicate, object) by entity category, as procedures write it."""


class Triplet(Struct, frozen=True):
    """One edge: <subject, predicate, object>, by node id."""

    subject: str
    predicate: str
    object: str

    def __str__(self) -> str:
        return f"<{self.subject}, {self.predicate}, {self.object}>"


class Entity(Struct, frozen=True, forbid_unknown_fields=True):
    """One category of O: an object that may occur in a scene."""

    OLD_KEYS: ClassVar[dict[str, str]] = {"seen_with": "visible_with"}

    name: str
    group: str
    """Its kind: "instrument", "anatomy", ..."""
    geometry: str
    """The shape that a perceiver reports for it: "point", "segment", "polyline", "surface", "circle", ..."""
    label: str = ""
    """Its everyday name, used in measure names (distance_to_<label>_mm) and drawings; `name` if empty."""
    fixed: bool = False
    """Registered in advance, so present in every graph but that of a missing image. Proofs assume it."""
    visible_with: str = ""
    """An entity, declared earlier, without which this one is left out of graphs. Proofs assume that neither
    is ever detected without the other."""
    only_with: str = ""
    """An entity without which this one is never detected; it may be detected alone. Proofs assume it."""

    @property
    def display_name(self) -> str:
        """The everyday name."""
        return self.label or self.name


class Relation(Struct, frozen=True, forbid_unknown_fields=True):
    """One relation that may hold between two entities, and the measure that decides it.

    It holds when the measure satisfies every bound. With `release` (hysteresis), a relation that holds
    continues to hold until the measure has passed `release` as well. With `margin_sd`, it holds wherever it
    cannot be excluded: some value within so many standard deviations of the measure satisfies the bounds.
    """

    OLD_KEYS: ClassVar[dict[str, str]] = {"called": "alias"}

    subject: str
    predicate: str
    object: str
    measure: str
    """Name of a function in `scene.relations`; its suffix gives the unit of the bounds."""
    at_most: float | None = None
    below: float | None = None
    at_least: float | None = None
    above: float | None = None
    release: float | None = None
    margin_sd: Annotated[float, Meta(ge=0, le=10)] = 0.0
    """In standard deviations of the measure."""
    given: tuple[Names, ...] = ()
    """Relations, declared earlier, that must hold as well."""
    alias: str = ""
    """Name of its measure in graphs and sentences where the default would be ambiguous; ends in the unit
    ("lift_mm")."""
    recorded_only: bool = False
    """Kept in graphs and recordings for analysis; no rule uses it."""
    reason: str | None = None
    """Why a threshold is meant that no eye seems to allow."""

    def __post_init__(self) -> None:
        unit = self.measure.rpartition("_")[2]
        if self.alias and not (self.alias.isidentifier() and self.alias.endswith(f"_{unit}")):
            raise ValueError(f"alias must be a name that ends in _{unit}, found {self.alias!r}")

    @property
    def names(self) -> Names:
        """Subject, predicate and object."""
        return self.subject, self.predicate, self.object

    @property
    def releases_upwards(self) -> bool:
        """Whether `release` relaxes the upper bound; otherwise it relaxes the lower one."""
        upper = self.below if self.at_most is None else self.at_most
        return self.release is not None and upper is not None and self.release >= upper

    def holds(self, value: float, *, held: bool = False, margin: float | Fraction = 0.0) -> bool:
        """Decide whether the relation holds.

        Args:
            value: The measure, in the unit of the bounds.
            held: Whether it held in the previous image.
            margin: `margin_sd` standard deviations of the measure, in its unit; infinite if unknown.
        """
        # The margin is compared with differences, because a small one would be lost when added to the value.
        small_enough = (self.at_most is None or value - self.at_most <= margin) and (
            self.below is None or value - self.below < margin
        )
        large_enough = (self.at_least is None or self.at_least - value <= margin) and (
            self.above is None or self.above - value < margin
        )
        if held and self.release is not None:
            if self.releases_upwards:
                small_enough = value - self.release <= margin
            else:
                large_enough = self.release - value <= margin
        return small_enough and large_enough

    def margin(self, sd: float | None) -> float:
        """Return the margin in the unit of the measure.

        Args:
            sd: Standard deviation of the measure; None if unknown: then nothing can be excluded.
        """
        return 0.0 if not self.margin_sd else inf if sd is None else self.margin_sd * sd

    def widened(self, sd: float | None) -> "Relation":
        """Return the relation without margin whose bounds are those that a standard deviation results in."""
        if not self.margin_sd:
            return self
        margin = self.margin(sd)
        changed = {
            "at_most": margin,
            "below": margin,
            "at_least": -margin,
            "above": -margin,
            "release": margin if self.releases_upwards else -margin,
        }
        bounds = {key: getattr(self, key) for key in changed}
        moved = {key: bound + changed[key] for key, bound in bounds.items() if bound is not None}
        return replace(self, margin_sd=0.0, **moved)


class Schema(Struct, frozen=True):
    """The entities (O) and relations (R) that may occur in a scene."""

    entities: tuple[Entity, ...]
    relations: tuple[Relation, ...]

    @property
    def phases(self) -> tuple[str, ...]:
        """Names of the phases of the operation, in order."""
        return tuple(entity.name for entity in self.entities if entity.geometry == "phase")

    def entity(self, name: str) -> Entity:
        """Return the entity of a name.

        Raises:
            KeyError: If the schema has no such entity.
        """
        for entity in self.entities:
            if entity.name == name:
                return entity
        raise KeyError(name)

    def widened(self, sds: Mapping[str, float]) -> "Schema":
        """Return the schema without margins whose bounds are those of an image.

        Args:
            sds: Standard deviations by the name of the measure, as a graph carries them.
        """
        relations = (one.widened(sds.get(self.measure_name(one))) for one in self.relations)
        return Schema(self.entities, tuple(relations))

    def measure_name(self, relation: Relation) -> str:
        """Return the name under which a graph carries the measure of a relation.

        A distance is named after its object ("distance_to_retina_mm"); other measures are unique or have an
        `alias`.
        """
        if relation.alias:
            return relation.alias
        if relation.measure == "distance_mm":
            return f"distance_to_{self.entity(relation.object).display_name}_mm"
        return relation.measure

    @property
    def measure_names(self) -> tuple[str, ...]:
        """Names of the measures that a graph may carry, each once."""
        return tuple(dict.fromkeys(self.measure_name(relation) for relation in self.relations))


class Node(Struct, frozen=True):
    """One node of V with its category phi(node)."""

    id: str
    category: str
    group: str


class GraphDiff(Struct, frozen=True):
    """What changed from one graph to another."""

    nodes_appeared: tuple[str, ...]
    nodes_vanished: tuple[str, ...]
    edges_appeared: tuple[Triplet, ...]
    edges_vanished: tuple[Triplet, ...]

    def __bool__(self) -> bool:
        return any((self.nodes_appeared, self.nodes_vanished, self.edges_appeared, self.edges_vanished))


class SceneGraph(Struct, ShownAsSvg, frozen=True):
    """The scene at one moment. Nodes and edges are in schema order, so equal scenes give equal bytes."""

    stamp_ns: int
    nodes: tuple[Node, ...] = ()
    edges: tuple[Triplet, ...] = ()
    measures: dict[str, float] = {}
    """The numbers that decided the edges, by name with unit ("theta_deg", "distance_to_retina_mm")."""
    sds: dict[str, float] = {}
    """Standard deviations of those measures for which a relation has a margin; an unknown one is left out."""

    def __repr__(self) -> str:
        edges = ", ".join(map(str, self.edges)) or "no edge"
        return f"<SceneGraph of {len(self.nodes)} nodes: {edges}>"

    def __contains__(self, edge: Triplet) -> bool:
        return edge in self.edges

    def find(
        self, subject: str | None = None, predicate: str | None = None, object: str | None = None
    ) -> tuple[Triplet, ...]:
        """Return the edges that match every given part; all edges if none is given."""
        return tuple(
            edge
            for edge in self.edges
            if (subject is None or edge.subject == subject)
            and (predicate is None or edge.predicate == predicate)
            and (object is None or edge.object == object)
        )

    def phi(self, node_id: str) -> str:
        """Return the category of a node.

        Raises:
            KeyError: If the graph has no such node.
        """
        for node in self.nodes:
            if node.id == node_id:
                return node.category
        raise KeyError(node_id)

    def diff(self, later: "SceneGraph") -> GraphDiff:
        """Return what appears and vanishes between this graph and a later one."""
        here, there = ({node.id for node in graph.nodes} for graph in (self, later))
        return GraphDiff(
            nodes_appeared=tuple(node.id for node in later.nodes if node.id not in here),
            nodes_vanished=tuple(node.id for node in self.nodes if node.id not in there),
            edges_appeared=tuple(edge for edge in later.edges if edge not in self.edges),
            edges_vanished=tuple(edge for edge in self.edges if edge not in later.edges),
        )

    def to_json(self) -> bytes:
        """Return the graph as JSON; equal graphs give equal bytes."""
        return msgspec.json.encode(self, order="deterministic")

    @classmethod
    def from_json(cls, data: bytes) -> "SceneGraph":
        """Read what `to_json` wrote.

        Raises:
            msgspec.ValidationError: If it is not such a graph.
        """
        return msgspec.json.decode(data, type=cls)

    def plot(self) -> "Figure":
        """Draw the graph: instruments on the left, other nodes on the right, predicates between them.

        Raises:
            MissingExtra: If Matplotlib is not installed.
        """
        figure: Figure = view("graph figure", self)
        return figure

    def to_networkx(self) -> "networkx.MultiDiGraph[str]":
        """Return a copy for NetworkX; nodes have the attributes category and group, edge keys are predicates.

        Raises:
            MissingExtra: If NetworkX is not installed.
        """
        try:
            import networkx  # noqa: PLC0415 - an extra
        except ImportError:
            raise MissingExtra("SceneGraph.to_networkx", "scenegraph") from None
        copy = networkx.MultiDiGraph(stamp_ns=self.stamp_ns, **self.measures)
        for node in self.nodes:
            copy.add_node(node.id, category=node.category, group=node.group)
        for edge in self.edges:
            copy.add_edge(edge.subject, edge.object, key=edge.predicate)
        return copy
