"""A procedure under proof: its rules as bit masks, the possible graphs of its schema, and the prover.

Turns worlds into violations that can be shown; the real rule engine evaluates each of them.
"""

from collections.abc import Callable, Iterable
from typing import Literal

from haptigraph.graph import Names, Node, Relation, SceneGraph, Triplet
from haptigraph.inference.claims import Gap
from haptigraph.inference.engine import RuleEngine, without_time
from haptigraph.inference.procedure import Procedure, State
from haptigraph.messages import UNKNOWN
from haptigraph.proof.exhaustive_prover import MAX_BITS, MAX_WORLDS, ExhaustiveProver
from haptigraph.proof.intervals import Interval
from haptigraph.proof.report import Violation
from haptigraph.proof.rules import Cube, Prover, rule_cubes
from haptigraph.proof.scales import bits_of
from haptigraph.proof.space import Space, World
from haptigraph.proof.z3_prover import Z3Prover

__all__ = ["Subject", "bounds_of"]


def bounds_of(part: Relation | Gap) -> Interval:
    """Return the values between the bounds of a part of a procedure, ignoring `release`."""
    return Interval.between(at_most=part.at_most, below=part.below, at_least=part.at_least, above=part.above)


class Subject:
    """The procedure that claims are about.

    Args:
        procedure: A checked procedure.
        prover: The method; auto: enumerate the graphs if there are few, else z3.

    Raises:
        MissingExtra: If z3 is needed and not installed.
    """

    def __init__(self, procedure: Procedure, prover: Literal["auto", "exhaustive", "z3"] = "auto") -> None:
        self.procedure = procedure
        self.space = Space(procedure.schema)
        self.rules = rule_cubes(procedure, self.space)
        self._engine = RuleEngine(without_time(procedure))
        is_small = self.space.count() <= MAX_WORLDS and self.space.visible.bit_length() <= MAX_BITS
        is_enumerated = prover == "exhaustive" or (prover == "auto" and is_small)
        self._chosen = ExhaustiveProver if is_enumerated else Z3Prover
        self.prover: Prover = self._chosen(self.space, self.rules)
        self._without: dict[int, Prover] = {}

    def without(self, number: int) -> Prover:
        """Return the prover of the other rules, as if one never fitted."""
        if number not in self._without:
            self._without[number] = self._chosen(self.space, self.rules[:number] + self.rules[number + 1 :])
        return self._without[number]

    def held_states(self, premise: Cube, violates: Callable[[State], bool]) -> tuple[str, ...]:
        """Return the states that violate a claim while they are held although a later rule matches.

        Args:
            premise: The graphs that the claim is about.
            violates: Whether a state violates it in such a graph.
        """
        states = self.procedure.states
        return tuple(
            state.name
            for number, state in enumerate(states)
            if state.hold_ms
            and violates(state)
            and self.prover.is_satisfiable(Cube(), number)
            and any(
                states[later].name != UNKNOWN and self.prover.is_satisfiable(premise, later)
                for later in range(number + 1, len(states))
            )
        )

    def violation(self, sentence: str, about: str, world: World) -> Violation:
        """Return a violation with its counterexample, whose state replaces "{state}" in the sentence."""
        graph = self.space.graph(world)
        state = self._state_of(graph)
        return Violation(
            sentence.replace("{state}", repr(state)),
            about,
            graph,
            state=state,
            still_holding=self._still_holding(graph),
        )

    def impossible(
        self, sentence: str, about: str, when: Iterable[Names], present: Iterable[str] = ()
    ) -> Violation:
        """Return a violation with the graph that would have to be possible but is not."""
        edges = list(when)
        entities = {name for names in edges for name in names[::2]} | set(present)
        graph = SceneGraph(
            stamp_ns=0,
            nodes=tuple(
                Node(entity.name, entity.name, entity.group)
                for entity in self.procedure.schema.entities
                if entity.name in entities
            ),
            edges=tuple(Triplet(*names) for names in edges),
        )
        return Violation(sentence, about, graph, is_possible=False, state=self._state_of(graph))

    def conflict(self, cube: Cube) -> str:
        """Name a minimal set of parts of an unsatisfiable cube that exclude each other."""
        require, forbid = cube.require, cube.forbid
        for bit in (1 << number for number in bits_of(require | forbid)):
            if not self.prover.is_satisfiable(Cube(require & ~bit, forbid & ~bit)):
                require, forbid = require & ~bit, forbid & ~bit
        has = [self._describe(bit) for bit in bits_of(require)]
        lacks = [f"no {self._describe(bit)}" for bit in bits_of(forbid)]
        return " with ".join([*has, *lacks])

    def _describe(self, bit: int) -> str:
        """Name a relation with its condition, or an entity."""
        schema = self.procedure.schema
        if bit >= len(schema.relations):
            return schema.entities[bit - len(schema.relations)].name
        relation = schema.relations[bit]
        return f"{Triplet(*relation.names)} ({bounds_of(relation).describe(schema.measure_name(relation))})"

    def _state_of(self, graph: SceneGraph) -> str:
        """Return the state of a graph by itself, whatever state is held."""
        return self._engine(graph).state

    def _still_holding(self, graph: SceneGraph) -> tuple[str, ...]:
        schema = self.procedure.schema.widened(graph.sds)
        return tuple(
            str(edge)
            for relation in schema.relations
            if (edge := Triplet(*relation.names)) in graph
            and not relation.holds(graph.measures[schema.measure_name(relation)])
        )
