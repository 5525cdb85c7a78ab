"""Infer the surgical state: prioritised rules on bit masks (paper, section II-D).

Every relation and every entity of the schema is one bit, a graph is an integer, a rule is a pair of masks;
the first matching rule wins. The only memory is how long ago a state with `hold_ms` matched, and since when
one with `enter_after_ms` does.
"""

from collections.abc import Collection
from typing import TypeAlias

from msgspec.structs import replace

from haptigraph.graph import Node, SceneGraph, Triplet
from haptigraph.inference.procedure import Procedure, State
from haptigraph.messages import UNKNOWN, Conclusion

__all__ = ["RuleEngine", "without_time"]

Scene: TypeAlias = tuple[tuple[Node, ...], tuple[Triplet, ...]]
NS_PER_MS = 1_000_000
MAX_CACHED_SCENES = 4096
"""A procedure has far fewer scenes, unless node ids keep changing."""


class _Measures(dict[str, object]):
    """Measures for a sentence, in which "?" stands for one that the graph does not carry."""

    def __missing__(self, name: str) -> object:
        return self

    def __format__(self, spec: str) -> str:
        return "?"


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
        self._with_margin = {
            state.name: _measures_with_margin(procedure, state) for state in procedure.states
        }
        self._cache: dict[Scene, int] = {}
        self._last: tuple[Scene | None, int] = None, 0
        followed = {
            pattern.name: [follow.measure for follow in pattern.follow] for pattern in procedure.patterns
        }
        self._followed = {state.name: followed[state.feel] for state in procedure.states}
        self._hold_ns = {
            state.name: round(state.hold_ms * NS_PER_MS) for state in procedure.states if state.hold_ms
        }
        self._enter_ns = {
            priority: round(state.enter_after_ms * NS_PER_MS)
            for priority, state in enumerate(procedure.states)
            if state.enter_after_ms
        }
        self._fits_since_ns: dict[int, int] = {}
        """By priority: since when a rule that must last has fitted."""
        self._last_match: Conclusion | None = None
        unknown = next(state for state in procedure.states if state.name == UNKNOWN)
        self._unknown_feel = unknown.feel

    def __call__(self, graph: SceneGraph) -> Conclusion:
        """Return the state of a graph; `unknown` if no rule matches."""
        conclusion = self._first_match(graph)
        return self._held(conclusion, graph) if self._hold_ns else conclusion

    def _first_match(self, graph: SceneGraph) -> Conclusion:
        scene = graph.nodes, graph.edges
        if scene != self._last[0]:  # usually equal and of the same objects, which is faster than hashing
            self._last = scene, self._priority_of(scene, graph)
        priority = self._entered(graph) if self._enter_ns else self._last[1]
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
            forces=state.force,
            because=_because(state, graph, self._with_margin[state.name]),
            evidence=evidence,
            measures=self._measures(state.name, graph),
        )

    def _priority_of(self, scene: Scene, graph: SceneGraph) -> int:
        """Return the index of the first rule that matches a scene, from the cache if possible."""
        priority = self._cache.get(scene)
        if priority is None:
            if len(self._cache) >= MAX_CACHED_SCENES:
                self._cache.clear()
            priority = self._cache[scene] = self._priority(self._mask(graph))
        return priority

    def _priority(self, mask: int, waiting: Collection[int] = ()) -> int:
        """Return the index of the first rule that matches, but for some; the number of rules if none does."""
        for priority, (require, forbid) in enumerate(self._rules):
            if mask & require == require and not mask & forbid and priority not in waiting:
                return priority
        return len(self._rules)

    def _entered(self, graph: SceneGraph) -> int:
        """Return the index of the first rule that matches and has matched for as long as it must."""
        mask, waiting = self._mask(graph), set()
        for priority, enter_ns in self._enter_ns.items():
            require, forbid = self._rules[priority]
            if mask & require == require and not mask & forbid:
                since_ns = self._fits_since_ns.setdefault(priority, graph.stamp_ns)
                if graph.stamp_ns - since_ns < enter_ns:
                    waiting.add(priority)
            else:
                self._fits_since_ns.pop(priority, None)
        return self._priority(mask, waiting)

    def _held(self, conclusion: Conclusion, graph: SceneGraph) -> Conclusion:
        """Hold the previous state, unless a rule of higher priority or no rule matches."""
        before = self._last_match
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
        self._last_match = conclusion
        return conclusion

    def _measures(self, state: str, graph: SceneGraph) -> dict[str, float]:
        """Return the measures that the pattern of a state follows."""
        return {name: graph.measures[name] for name in self._followed[state] if name in graph.measures}

    def reset(self) -> None:
        """Forget the state that is held, and those that wait."""
        self._last_match = None
        self._fits_since_ns.clear()

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


def without_time(procedure: Procedure) -> Procedure:
    """Return a procedure that judges every graph by itself: no state is held, none waits."""
    states = tuple(replace(state, hold_ms=0.0, enter_after_ms=0.0) for state in procedure.states)
    return replace(procedure, states=states)


def _measures_with_margin(procedure: Procedure, state: State) -> tuple[str, ...]:
    """Return the measures whose standard deviations decide whether the rule of a state fits."""
    relations = {relation.names: relation for relation in procedure.schema.relations}
    used = (relations[names] for names in state.when)
    return tuple(dict.fromkeys(procedure.schema.measure_name(each) for each in used if each.margin_sd))


def _because(state: State, graph: SceneGraph, with_margin: tuple[str, ...]) -> str:
    """Fill the measures of a graph into the sentence of a state; say which standard deviations it lacks."""
    try:
        because = state.because.format_map(graph.measures)
    except KeyError:
        because = state.because.format_map(_Measures(graph.measures))
    unknown = [name for name in with_margin if name in graph.measures and name not in graph.sds]
    if not unknown:
        return because
    return f"{because}; it cannot be excluded: the standard deviation of {', '.join(unknown)} is unknown"
