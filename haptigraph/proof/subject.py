"""A procedure on the bench: its rules as bits, what is possible under its schema, and who proves.

Makes worlds into violations that can be shown, each run through the real rule engine.
"""

from collections.abc import Iterable
from typing import Literal

from haptigraph.graph import Names, Node, Relation, SceneGraph, Triplet
from haptigraph.inference.claims import Gap
from haptigraph.inference.engine import RuleEngine
from haptigraph.inference.procedure import Procedure
from haptigraph.proof.by_z3 import BySolver
from haptigraph.proof.exhaustive import MOST_BITS, MOST_WORLDS, Exhaustive
from haptigraph.proof.intervals import Interval
from haptigraph.proof.report import Violation
from haptigraph.proof.rules import Cube, Prover, cubes_of
from haptigraph.proof.scales import bits_of
from haptigraph.proof.space import Space, World

__all__ = ["PROVERS", "Subject", "bounds_of"]

PROVERS = ("auto", "exhaustive", "z3")


def bounds_of(part: Relation | Gap) -> Interval:
    """Return the values between the bounds of a part of a procedure, `release` left aside."""
    return Interval.between(at_most=part.at_most, below=part.below, at_least=part.at_least, above=part.above)


class Subject:
    """What is proved about.

    Args:
        procedure: A checked procedure.
        prover: Who proves; auto: by looking at every graph where there are few, else z3.

    Raises:
        MissingExtra: If z3 is needed and not installed.
    """

    def __init__(self, procedure: Procedure, prover: Literal["auto", "exhaustive", "z3"] = "auto") -> None:
        self.procedure = procedure
        self.space = Space(procedure.schema)
        self.rules = cubes_of(procedure, self.space)
        self._engine = RuleEngine(procedure)
        is_small = self.space.count() <= MOST_WORLDS and self.space.visible.bit_length() <= MOST_BITS
        looks = prover == "exhaustive" or (prover == "auto" and is_small)
        chosen = Exhaustive if looks else BySolver
        self.prover: Prover = chosen(self.space, self.rules)

    def violation(self, sentence: str, about: str, world: World) -> Violation:
        """Return a violation with the possible graph that shows it, whose state "{state}" stands for."""
        graph = self.space.graph(world)
        state = self._state_of(graph)
        return Violation(
            sentence.replace("{state}", repr(state)),
            about,
            graph,
            state=state,
            still_holding=self._still_holding(world),
        )

    def impossible(
        self, sentence: str, about: str, when: Iterable[Names], present: Iterable[str] = ()
    ) -> Violation:
        """Return a violation with a graph that cannot be, but would have to."""
        wanted = list(when)
        there = {name for names in wanted for name in names[::2]} | set(present)
        graph = SceneGraph(
            stamp_ns=0,
            nodes=tuple(
                Node(entity.name, entity.name, entity.group)
                for entity in self.procedure.schema.entities
                if entity.name in there
            ),
            edges=tuple(Triplet(*names) for names in wanted),
        )
        return Violation(sentence, about, graph, is_possible=False, state=self._state_of(graph))

    def conflict(self, wanted: Cube) -> str:
        """Say which few parts of an impossible wish cannot be together."""
        require, forbid = wanted.require, wanted.forbid
        for bit in (1 << number for number in bits_of(require | forbid)):
            if not self.prover.exists(Cube(require & ~bit, forbid & ~bit)):
                require, forbid = require & ~bit, forbid & ~bit
        has = [self.named(bit) for bit in bits_of(require)]
        lacks = [f"no {self.named(bit)}" for bit in bits_of(forbid)]
        return " with ".join([*has, *lacks])

    def named(self, bit: int) -> str:
        """Name a relation, with what decides it, or an entity."""
        schema = self.procedure.schema
        if bit >= len(schema.relations):
            return schema.entities[bit - len(schema.relations)].name
        relation = schema.relations[bit]
        return f"{Triplet(*relation.names)} ({bounds_of(relation).said(schema.measure_name(relation))})"

    def _state_of(self, graph: SceneGraph) -> str:
        """Return what a graph is by itself, whatever state is held."""
        self._engine.reset()
        return self._engine(graph).state

    def _still_holding(self, world: World) -> tuple[str, ...]:
        held = sum(place.mask & ~place.cell.enter for place in world.places if place is not None)
        relations = self.procedure.schema.relations
        return tuple(str(Triplet(*relations[bit].names)) for bit in bits_of(held & world.mask))
