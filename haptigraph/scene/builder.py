"""Build the scene graph of one observation: the entities that are present and the relations that hold."""

from math import hypot, inf

from msgspec.structs import replace

from haptigraph.geometry import Geometry, Point, Polyline, height_on_polyline
from haptigraph.graph import Node, Relation, SceneGraph, Schema, Triplet
from haptigraph.messages import Observation
from haptigraph.scene.relations import MEASURES, Found, Measure

__all__ = ["SchemaSceneBuilder"]


class SchemaSceneBuilder:
    """Evaluate every relation of a schema on an observation.

    An entity is left out if the one that it is `visible_with` was not detected, because proofs assume that.
    A relation with a margin holds if the standard deviation is unknown: then it cannot be excluded.

    Args:
        schema: Entities and relations; all their measures are in `MEASURES`.
    """

    def __init__(self, schema: Schema) -> None:
        self._nodes = [Node(entity.name, entity.name, entity.group) for entity in schema.entities]
        self._relations = [
            (
                relation,
                MEASURES[relation.measure],
                schema.measure_name(relation),
                Triplet(*relation.names),
                [Triplet(*names) for names in relation.given],
            )
            for relation in schema.relations
        ]
        self._visible_with = [
            (entity.name, entity.visible_with) for entity in schema.entities if entity.visible_with
        ]
        self._held: frozenset[Triplet] = frozenset()

    def __call__(self, observation: Observation) -> SceneGraph:
        """Return the graph of one observation."""
        found = self._covered(observation.found)
        measures: dict[str, float] = {}
        sds: dict[str, float] = {}
        edges: list[Triplet] = []
        for relation, measure, name, edge, given in self._relations:
            if name not in measures:
                subject, object_ = found.get(relation.subject), found.get(relation.object)
                if subject is None or object_ is None:
                    continue
                value = measure.function(subject, object_, found)
                if value is None:
                    continue
                measures[name] = value
            if relation.margin_sd and (sd := _sd(measure, relation, found, observation)) is not None:
                sds[name] = sd
            margin = relation.margin(sds.get(name)) if relation.margin_sd else 0.0
            holds = relation.holds(measures[name], held=edge in self._held, margin=margin)
            if holds and all([other in edges for other in given]):
                edges.append(edge)
        self._held = frozenset(edges)
        nodes = tuple([node for node in self._nodes if node.id in found])
        return SceneGraph(observation.stamp_ns, nodes, tuple(edges), measures, sds)

    def reset(self) -> None:
        """Forget which relations held."""
        self._held = frozenset()

    def resume(self, graph: SceneGraph) -> None:
        """Continue after a graph: its relations hold."""
        self._held = frozenset(graph.edges)

    def _covered(self, found: Found) -> Found:
        """Return the entities without those that are never detected alone, where they are."""
        for name, other in self._visible_with:
            if name in found and other not in found:
                found = {key: shape for key, shape in found.items() if key != name}
        return found


def _sd(measure: Measure, relation: Relation, found: Found, observation: Observation) -> float | None:
    """Return the standard deviation of a measure, from those of subject and object; None if it is unknown."""
    certainty, at = observation.certainty, found[relation.subject]
    if measure.sd is None or certainty is None:
        return None
    one, other = (_known_sd_mm(name, at, found, observation) for name in (relation.subject, relation.object))
    own = certainty.tip_sd_mm if one is None else one
    if own is not None and (one is not None or other is not None):
        certainty = replace(certainty, tip_sd_mm=hypot(own, other or 0.0))
    sd = measure.sd(certainty)
    return sd if sd is not None and 0 <= sd < inf else None  # nan is unknown, too


def _known_sd_mm(name: str, at: Geometry, found: Found, observation: Observation) -> float | None:
    """Return the standard deviation of an entity below a point; None if only `certainty` has one, or none."""
    known, shape = observation.sd_mm.get(name), found[name]
    if not isinstance(known, tuple):
        return known
    if isinstance(at, Point) and isinstance(shape, Polyline) and len(known) == len(shape.points_mm):
        heights = tuple((x, sd_mm) for (x, _), sd_mm in zip(shape.points_mm, known, strict=True))
        return height_on_polyline(at.at_mm[0], Polyline(heights))
    return None
