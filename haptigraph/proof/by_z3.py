"""Prove with the solver z3, where possible graphs are too many to be looked at one by one.

Measures are real numbers here, not cells: thresholds and what geometry always says are left to the solver.
"""

from fractions import Fraction
from math import isinf
from typing import Any

from haptigraph.errors import MissingExtra
from haptigraph.proof.intervals import Interval
from haptigraph.proof.rules import Cube
from haptigraph.proof.scales import bits_of
from haptigraph.proof.space import Place, Space, World

__all__ = ["BySolver"]

EFFORT = 300_000
"""What z3 may spend on finding a smaller graph, in its own deterministic unit."""


class BySolver:
    """Ask z3.

    Args:
        space: What is possible.
        rules: What each rule fits, first that fits wins.

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
        count = space.visible.bit_length() + len(space.unnamed)
        self._bits = [z3.Bool(f"bit{number}") for number in range(count)]
        self._raw = [z3.Bool(f"raw{number}") for number in range(len(space.schema.relations))]
        self._values = [z3.Real(scale.name) for scale in space.scales]
        self._seen = bits_of(space.visible)
        self._solver = z3.Solver()
        self._solver.add(*self._who_is_there(), *self._what_holds())
        self.method = f"z3 {z3.get_version_string()} on {space.count():,} combinations of places and entities"

    def exists(self, wanted: Cube, fires: int | None = None) -> bool:
        """Tell whether there is a possible graph; see `Prover`."""
        return bool(self._solver.check(*self._asked(wanted, fires)) == self._z3.sat)

    def smallest(self, wanted: Cube, fires: int | None = None) -> World | None:
        """Return a small possible graph, or None if there is none; see `Prover`.

        That there is none is always proved; that there is no smaller one, only within `EFFORT`.
        """
        z3, solver = self._z3, self._solver
        best = None
        solver.push()
        solver.add(*self._asked(wanted, fires))
        while solver.check() == z3.sat:
            best = self._world(solver.model())
            size = (best.mask & self._space.visible).bit_count()
            solver.add(z3.PbLe([(self._bits[bit], 1) for bit in self._seen], size - 1))
            solver.set("rlimit", EFFORT)
        solver.set("rlimit", 0)
        solver.pop()
        return best

    def _asked(self, wanted: Cube, fires: int | None) -> list[Any]:
        if fires is None:
            return [self._is(wanted)]
        earlier = [self._z3.Not(self._is(rule)) for rule in self._rules[:fires]]
        return [self._is(wanted), *earlier, *(self._is(rule) for rule in self._rules[fires : fires + 1])]

    def _is(self, wanted: Cube) -> Any:
        has = [self._bits[bit] for bit in bits_of(wanted.require)]
        lacks = [self._z3.Not(self._bits[bit]) for bit in bits_of(wanted.forbid)]
        return self._z3.And(*has, *lacks)

    def _all_of(self, mask: int) -> Any:
        return self._z3.And(*(self._bits[bit] for bit in bits_of(mask)))

    def _who_is_there(self) -> list[Any]:
        """Nothing at all, or what is fixed and any of the sets that come and go together."""
        z3, space = self._z3, self._space
        everyone = sum(space.entity_bits.values())
        nothing = z3.And(*(z3.Not(self._bits[bit]) for bit in bits_of(everyone)))
        alike = []
        for cluster in space.clusters:
            first, *others = bits_of(cluster)
            alike += [self._bits[bit] == self._bits[first] for bit in others]
        return [*alike, z3.Or(nothing, self._all_of(space.fixed))]

    def _what_holds(self) -> list[Any]:
        z3, space = self._z3, self._space
        facts = []
        there = []
        for scale, value in zip(space.scales, self._values, strict=True):
            measured = z3.And(*(self._bits[bits_of(space.entity_bits[name])[0]] for name in scale.needs))
            there.append(measured)
            places = [
                z3.And(self._lies(value, cell.interval), self._raw_is(scale.bits, mask))
                for cell in scale.cells
                for mask in cell.masks
            ]
            facts += [
                z3.Implies(measured, z3.Or(*places)),
                z3.Implies(z3.Not(measured), self._raw_is(scale.bits, 0)),
            ]
        for small, large in space.never_above.items():
            both = z3.And(there[small], there[large])
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

    def _lies(self, value: Any, interval: Interval) -> Any:
        parts = []
        if not isinf(interval.low):
            low = self._exact(interval.low)
            parts.append(value >= low if interval.low_in else value > low)
        if not isinf(interval.high):
            high = self._exact(interval.high)
            parts.append(value <= high if interval.high_in else value < high)
        return self._z3.And(*parts)

    def _exact(self, number: float) -> Any:
        return self._z3.Q(*number.as_integer_ratio())

    def _world(self, model: Any) -> World:
        """Read a world from what the solver found."""
        space = self._space

        def is_true(what: Any) -> bool:
            return bool(self._z3.is_true(model.eval(what, model_completion=True)))

        present = sum(bit for bit in space.entity_bits.values() if is_true(self._bits[bits_of(bit)[0]]))
        places: list[Place | None] = []
        for scale, value, here in zip(space.scales, self._values, space.measured(present), strict=True):
            if not here:
                places.append(None)
                continue
            found = model.eval(value, model_completion=True)
            exact = Fraction(found.numerator_as_long(), found.denominator_as_long())
            cell = next(cell for cell in scale.cells if _holds(cell.interval, exact))
            mask = sum(1 << number for number in scale.relations if is_true(self._raw[number]))
            places.append(Place(cell, mask))
        return space.world(present, tuple(places))


def _holds(interval: Interval, exact: Fraction) -> bool:
    # Comparisons of fractions with floats are exact, those with infinity too.
    above = exact > interval.low or (interval.low_in and exact == interval.low)
    return above and (exact < interval.high or (interval.high_in and exact == interval.high))
