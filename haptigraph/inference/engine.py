"""Infer the surgical state: prioritised rules on bit masks (paper, section II-D).

Every relation and every entity of the schema is one bit, a graph is an integer, a rule is a pair of masks;
the first rule whose pattern fits wins. Remembers only how long ago a state with `hold_ms` fitted; knows
nothing of millimetres.
"""

from typing import TypeAlias

from msgspec.structs import replace

from haptigraph.graph import Node, SceneGraph, Triplet
from haptigraph.inference.explain import because
from haptigraph.inference.procedure import Procedure, State
from haptigraph.messages import UNKNOWN, Conclusion

__all__ = ["RuleEngine"]

Scene: TypeAlias = tuple[tuple[Node, ...], tuple[Triplet, ...]]
NS_PER_MS = 1_000_000
MOST_REMEMBERED = 4096
"""Scenes whose rule is remembered; a procedure has far fewer, unless nodes are called ever anew."""


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
        self._rules = [self._compile(state) for state in procedure.states]
        self._states = [(state, tuple(Triplet(*names) for names in state.when)) for state in procedure.states]
        self._fits: dict[Scene, int] = {}
        self._last: tuple[Scene | None, int] = None, 0
        follows = {
            pattern.name: [follow.measure for follow in pattern.follow] for pattern in procedure.patterns
        }
        self._follows = {state.name: follows[state.feel] for state in procedure.states}
        self._hold_ns = {
            state.name: round(state.hold_ms * NS_PER_MS) for state in procedure.states if state.hold_ms
        }
        self._fitted: Conclusion | None = None
        unknown = next(state for state in procedure.states if state.name == UNKNOWN)
        self._unknown_feel = unknown.feel

    def __call__(self, graph: SceneGraph) -> Conclusion:
        """Return the state of a graph; a graph that no rule fits is unknown."""
        conclusion = self._first_that_fits(graph)
        return self._held(conclusion, graph) if self._hold_ns else conclusion

    def _first_that_fits(self, graph: SceneGraph) -> Conclusion:
        scene = graph.nodes, graph.edges
        if scene != self._last[0]:  # mostly it is, of the very same parts: seen sooner than hashed
            self._last = scene, self._priority_of(scene, graph)
        priority = self._last[1]
        if priority == len(self._rules):
            return Conclusion(
                stamp_ns=graph.stamp_ns,
                state=UNKNOWN,
                priority=priority,
                feel=self._unknown_feel,
                because="no rule of the procedure fits this scene",
            )
        state, evidence = self._states[priority]
        return Conclusion(
            stamp_ns=graph.stamp_ns,
            state=state.name,
            priority=priority,
            feel=state.feel,
            because=because(state, graph),
            evidence=evidence,
            measures=self._measures(state.name, graph),
        )

    def _priority_of(self, scene: Scene, graph: SceneGraph) -> int:
        """Return the number of the first rule that fits a scene, remembered or found."""
        priority = self._fits.get(scene)
        if priority is None:
            if len(self._fits) >= MOST_REMEMBERED:
                self._fits.clear()
            priority = self._fits[scene] = self._priority(self._mask(graph))
        return priority

    def _priority(self, mask: int) -> int:
        """Return the number of the first rule that fits; the number of rules if none does."""
        for priority, (require, forbid) in enumerate(self._rules):
            if mask & require == require and not mask & forbid:
                return priority
        return len(self._rules)

    def _held(self, conclusion: Conclusion, graph: SceneGraph) -> Conclusion:
        """Let the state before stay while it is held, unless one of higher priority fits, or none does."""
        before = self._fitted
        if before is not None and before.priority < conclusion.priority and conclusion.state != UNKNOWN:
            age_ns = graph.stamp_ns - before.stamp_ns
            if age_ns < self._hold_ns.get(before.state, 0):
                return replace(
                    before,
                    stamp_ns=graph.stamp_ns,
                    because=f"held; {age_ns / NS_PER_MS:.0f} ms ago {before.because}",
                    evidence=(),
                    measures=self._measures(before.state, graph),
                )
        self._fitted = conclusion
        return conclusion

    def _measures(self, state: str, graph: SceneGraph) -> dict[str, float]:
        """Return the measures that the pattern of a state follows."""
        return {name: graph.measures[name] for name in self._follows[state] if name in graph.measures}

    def reset(self) -> None:
        """Hold no state any more."""
        self._fitted = None

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
