"""Build the scene graph of one observation: the entities that are present and the relations that hold."""

from haptigraph.graph import Node, Relation, SceneGraph, Schema, Triplet
from haptigraph.messages import Observation
from haptigraph.scene.relations import MEASURES

__all__ = ["SchemaSceneBuilder"]


class SchemaSceneBuilder:
    """Evaluate every relation of a schema on an observation.

    Args:
        schema: Entities and relations; all their measures are in `MEASURES`.
    """

    def __init__(self, schema: Schema) -> None:
        self._nodes = [Node(entity.name, entity.name, entity.group) for entity in schema.entities]
        self._relations = [
            (
                relation,
                schema.measure_name(relation),
                Triplet(*relation.names),
                [Triplet(*names) for names in relation.given],
            )
            for relation in schema.relations
        ]
        self._held: frozenset[Triplet] = frozenset()

    def __call__(self, observation: Observation) -> SceneGraph:
        """Return the graph of one observation."""
        measures: dict[str, float] = {}
        edges: list[Triplet] = []
        for relation, name, edge, given in self._relations:
            if name not in measures:
                value = _measure(relation, observation)
                if value is None:
                    continue
                measures[name] = value
            holds = relation.holds(measures[name], held=edge in self._held)
            if holds and all(other in edges for other in given):
                edges.append(edge)
        self._held = frozenset(edges)
        nodes = tuple(node for node in self._nodes if node.id in observation.found)
        return SceneGraph(observation.stamp_ns, nodes, tuple(edges), measures)

    def reset(self) -> None:
        """Forget which relations held."""
        self._held = frozenset()


def _measure(relation: Relation, observation: Observation) -> float | None:
    found = observation.found
    subject, object_ = found.get(relation.subject), found.get(relation.object)
    if subject is None or object_ is None:
        return None
    return MEASURES[relation.measure].function(subject, object_, found)
