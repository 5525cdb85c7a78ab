"""Prove claims with the solver z3, for spaces that are too large to enumerate.

Measures are real numbers here, not cells: the solver handles thresholds and geometric limits.
"""

from fractions import Fraction
from math import isinf
from typing import Any

from haptigraph.errors import MissingExtra
from haptigraph.proof.intervals import Interval
from haptigraph.proof.rules import Cube
from haptigraph.proof.scales import bits_of
from haptigraph.proof.space import CellState, Space, World

__all__ = ["Z3Prover"]

RESOURCE_LIMIT = 300_000
"""What z3 may spend on finding a smaller graph, in its own deterministic unit."""


class Z3Prover:
    """Decide queries with z3.

    Args:
        space: The possible graphs.
        rules: The graphs that each rule matches; the first match wins.

    Raises:
        MissingExtra: If z3 is not installed.
    """

    def __init__(self, space: Space, rules: list[Cube]) -> None:
        try:
            import z3  # noqa: PLC0415 - an extra
        except ImportError:
            raise MissingExtra("proving over so many graphs", "proof") from None
        self._z3: Any = z3
        self._space, self._rules = space, rules
        count = space.visible.bit_length() + len(space.undeclared)
        self._bits = [z3.Bool(f"bit{number}") for number in range(count)]
        self._raw = [z3.Bool(f"raw{number}") for number in range(len(space.schema.relations))]
        self._values = [z3.Real(scale.name) for scale in space.scales]
        self._visible = bits_of(space.visible)
        self._solver = z3.Solver()
        self._solver.add(*self._entity_constraints(), *self._relation_constraints())
        self.method = f"z3 {z3.get_version_string()} on {space.count():,} combinations of cells and entities"

    def is_satisfiable(self, cube: Cube, first_match: int | None = None) -> bool:
        """Return whether such a graph is possible; see `Prover`."""
        return bool(self._solver.check(*self._query(cube, first_match)) == self._z3.sat)

    def smallest_witness(self, cube: Cube, first_match: int | None = None) -> World | None:
        """Return a small such graph, or None if there is none; see `Prover`.

        The result None is always proved; that no smaller graph exists, only within `RESOURCE_LIMIT`.
        """
        z3, solver = self._z3, self._solver
        best = None
        solver.push()
        solver.add(*self._query(cube, first_match))
        while solver.check() == z3.sat:
            best = self._world(solver.model())
            size = (best.mask & self._space.visible).bit_count()
            solver.add(z3.PbLe([(self._bits[bit], 1) for bit in self._visible], size - 1))
            solver.set("rlimit", RESOURCE_LIMIT)
        solver.set("rlimit", 0)
        solver.pop()
        return best

    def _query(self, cube: Cube, first_match: int | None) -> list[Any]:
        if first_match is None:
            return [self._in_cube(cube)]
        earlier = [self._z3.Not(self._in_cube(rule)) for rule in self._rules[:first_match]]
        matching = [self._in_cube(rule) for rule in self._rules[first_match : first_match + 1]]
        return [self._in_cube(cube), *earlier, *matching]

    def _in_cube(self, cube: Cube) -> Any:
        has = [self._bits[bit] for bit in bits_of(cube.require)]
        lacks = [self._z3.Not(self._bits[bit]) for bit in bits_of(cube.forbid)]
        return self._z3.And(*has, *lacks)

    def _all_of(self, mask: int) -> Any:
        return self._z3.And(*(self._bits[bit] for bit in bits_of(mask)))

    def _entity_constraints(self) -> list[Any]:
        """Either no entity at all, or the fixed ones and any sets that appear and vanish together."""
        z3, space = self._z3, self._space
        everyone = sum(space.entity_bits.values())
        nothing = z3.And(*(z3.Not(self._bits[bit]) for bit in bits_of(everyone)))
        alike = []
        for cluster in space.clusters:
            first, *others = bits_of(cluster)
            alike += [self._bits[bit] == self._bits[first] for bit in others]
        only_with = [z3.Implies(self._all_of(one), self._all_of(other)) for one, other in space.only_with]
        return [*alike, *only_with, z3.Or(nothing, self._all_of(space.fixed))]

    def _relation_constraints(self) -> list[Any]:
        z3, space = self._z3, self._space
        facts = []
        defined = []
        for scale, value in zip(space.scales, self._values, strict=True):
            is_defined = z3.And(*(self._bits[bits_of(space.entity_bits[name])[0]] for name in scale.requires))
            defined.append(is_defined)
            cell_states = [
                z3.And(self._in_interval(value, cell.interval), self._raw_is(scale.bits, mask))
                for cell in scale.cells
                for mask in cell.masks
            ]
            facts += [
                z3.Implies(is_defined, z3.Or(*cell_states)),
                z3.Implies(z3.Not(is_defined), self._raw_is(scale.bits, 0)),
            ]
        for small, large in space.never_above.items():
            both = z3.And(defined[small], defined[large])
            facts.append(z3.Implies(both, self._values[small] <= self._values[large]))
        for number, relation in enumerate(space.schema.relations):
            given = sum(space.edge_bits[names] for names in set(relation.given))
            facts.append(self._bits[number] == z3.And(self._raw[number], self._all_of(given)))
        return facts

    def _raw_is(self, bits: int, mask: int) -> Any:
        z3 = self._z3
        return z3.And(
            *(self._raw[bit] if mask >> bit & 1 else z3.Not(self._raw[bit]) for bit in bits_of(bits))
        )

    def _in_interval(self, value: Any, interval: Interval) -> Any:
        parts = []
        if not isinf(interval.low):
            low = self._exact(interval.low)
            parts.append(value >= low if interval.has_low else value > low)
        if not isinf(interval.high):
            high = self._exact(interval.high)
            parts.append(value <= high if interval.has_high else value < high)
        return self._z3.And(*parts)

    def _exact(self, number: float) -> Any:
        return self._z3.Q(*number.as_integer_ratio())

    def _world(self, model: Any) -> World:
        """Convert a model of the solver to a world."""
        space = self._space

        def is_true(expression: Any) -> bool:
            return bool(self._z3.is_true(model.eval(expression, model_completion=True)))

        present = sum(bit for bit in space.entity_bits.values() if is_true(self._bits[bits_of(bit)[0]]))
        cell_states: list[CellState | None] = []
        measured = space.measured(present)
        for scale, value, is_defined in zip(space.scales, self._values, measured, strict=True):
            if not is_defined:
                cell_states.append(None)
                continue
            found = model.eval(value, model_completion=True)
            exact = Fraction(found.numerator_as_long(), found.denominator_as_long())
            cell = next(cell for cell in scale.cells if exact in cell.interval)
            mask = sum(1 << number for number in scale.relations if is_true(self._raw[number]))
            cell_states.append(CellState(cell, mask))
        return space.world(present, tuple(cell_states))
