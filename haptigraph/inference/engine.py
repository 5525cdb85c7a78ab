"""Infer the surgical state: prioritised rules on bit masks (paper, section II-D).

Every relation and every entity of the schema is one bit, a graph is an integer, a rule is a pair of masks;
the first rule whose pattern fits wins. Remembers nothing and knows nothing of millimetres.
"""

from haptigraph.graph import SceneGraph, Triplet
from haptigraph.inference.explain import because
from haptigraph.inference.procedure import Procedure, State
from haptigraph.messages import UNKNOWN, Conclusion

__all__ = ["RuleEngine"]


class RuleEngine:
    """Evaluate the rules of one procedure.

    Args:
        procedure: A checked procedure.
    """

    def __init__(self, procedure: Procedure) -> None:
        schema = procedure.schema
        self._edge_bits = {relation.names: 1 << number for number, relation in enumerate(schema.relations)}
        self._entity_bits = {
            entity.name: 1 << (len(schema.relations) + number)
            for number, entity in enumerate(schema.entities)
        }
        self._rules = [
            (*self._compile(state), state, tuple(Triplet(*names) for names in state.when))
            for state in procedure.states
        ]
        unknown = next(state for state in procedure.states if state.name == UNKNOWN)
        self._unknown_feel = unknown.feel

    def __call__(self, graph: SceneGraph) -> Conclusion:
        """Return the state of a graph; a graph that no rule fits is unknown."""
        mask = self._mask(graph)
        for priority, (require, forbid, state, evidence) in enumerate(self._rules):
            if mask & require == require and not mask & forbid:
                return Conclusion(
                    stamp_ns=graph.stamp_ns,
                    state=state.name,
                    priority=priority,
                    feel=state.feel,
                    because=because(state, graph),
                    evidence=evidence,
                )
        return Conclusion(
            stamp_ns=graph.stamp_ns,
            state=UNKNOWN,
            priority=len(self._rules),
            feel=self._unknown_feel,
            because="no rule of the procedure fits this scene",
        )

    def reset(self) -> None:
        """Do nothing: rules have no memory."""

    def _mask(self, graph: SceneGraph) -> int:
        category = {node.id: node.category for node in graph.nodes}
        mask = 0
        for name in category.values():
            mask |= self._entity_bits.get(name, 0)
        for edge in graph.edges:
            names = category[edge.subject], edge.predicate, category[edge.object]
            mask |= self._edge_bits.get(names, 0)
        return mask

    def _compile(self, state: State) -> tuple[int, int]:
        require = sum(self._edge_bits[names] for names in set(state.when))
        forbid = sum(self._edge_bits[names] for names in set(state.unless))
        return require, forbid | sum(self._entity_bits[name] for name in set(state.absent))
