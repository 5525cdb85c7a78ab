"""Prove by looking at every possible graph, as an array of bit masks."""

import numpy as np
from numpy.typing import NDArray

from haptigraph.proof.rules import Cube
from haptigraph.proof.space import Space, World

__all__ = ["MOST_BITS", "MOST_WORLDS", "Exhaustive"]

MOST_WORLDS = 50_000
"""More are left to z3."""
MOST_BITS = 62


class Exhaustive:
    """Every graph that is possible, smallest first.

    Args:
        space: What is possible; small enough to be counted through.
        rules: What each rule fits, first that fits wins.
    """

    def __init__(self, space: Space, rules: list[Cube]) -> None:
        worlds: dict[int, World] = {}
        for world in space.worlds():
            worlds.setdefault(world.mask & space.visible, world)
        order = sorted(worlds, key=lambda mask: (mask.bit_count(), mask))
        self._worlds = [worlds[mask] for mask in order]
        self._masks = np.array(order, dtype=np.int64)
        self._fired = np.full(len(order), len(rules))
        for number in reversed(range(len(rules))):
            self._fired[self._fitting(rules[number])] = number
        self.method = f"looked at all {len(order):,} possible graphs"

    def exists(self, wanted: Cube, fires: int | None = None) -> bool:
        """Tell whether there is a possible graph; see `Prover`."""
        return self.smallest(wanted, fires) is not None

    def smallest(self, wanted: Cube, fires: int | None = None) -> World | None:
        """Return a smallest possible graph, or None if there is none; see `Prover`."""
        fitting = self._fitting(wanted)
        if fires is not None:
            fitting &= self._fired == fires
        at = int(fitting.argmax())
        return self._worlds[at] if fitting[at] else None

    def _fitting(self, wanted: Cube) -> NDArray[np.bool_]:
        has = np.equal(self._masks & wanted.require, wanted.require)
        lacks = np.equal(self._masks & wanted.forbid, 0)
        fitting: NDArray[np.bool_] = has & lacks
        return fitting
