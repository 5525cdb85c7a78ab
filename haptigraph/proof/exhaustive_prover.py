"""Prove claims by enumerating every possible graph as an array of bit masks."""

import numpy as np
from numpy.typing import NDArray

from haptigraph.proof.rules import Cube
from haptigraph.proof.space import Space, World

__all__ = ["MAX_BITS", "MAX_WORLDS", "ExhaustiveProver"]

MAX_WORLDS = 50_000
"""Larger spaces are left to z3."""
MAX_BITS = 62


class ExhaustiveProver:
    """Every possible graph, smallest first.

    Args:
        space: The possible graphs; few enough to enumerate.
        rules: The graphs that each rule matches; the first match wins.
    """

    def __init__(self, space: Space, rules: list[Cube]) -> None:
        worlds: dict[int, World] = {}
        for world in space.worlds():
            worlds.setdefault(world.mask & space.visible, world)
        order = sorted(worlds, key=lambda mask: (mask.bit_count(), mask))
        self._worlds = [worlds[mask] for mask in order]
        self._masks = np.array(order, dtype=np.int64)
        self._first_matches = np.full(len(order), len(rules))
        for number in reversed(range(len(rules))):
            self._first_matches[self._matching(rules[number])] = number
        self.method = f"looked at all {len(order):,} possible graphs"

    def is_satisfiable(self, cube: Cube, first_match: int | None = None) -> bool:
        """Return whether such a graph is possible; see `Prover`."""
        return self.smallest_witness(cube, first_match) is not None

    def smallest_witness(self, cube: Cube, first_match: int | None = None) -> World | None:
        """Return a smallest such graph, or None if there is none; see `Prover`."""
        matching = self._matching(cube)
        if first_match is not None:
            matching &= self._first_matches == first_match
        at = int(matching.argmax())
        return self._worlds[at] if matching[at] else None

    def _matching(self, cube: Cube) -> NDArray[np.bool_]:
        has = np.equal(self._masks & cube.require, cube.require)
        lacks = np.equal(self._masks & cube.forbid, 0)
        matching: NDArray[np.bool_] = has & lacks
        return matching
