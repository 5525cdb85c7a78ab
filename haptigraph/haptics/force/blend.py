"""Blend the fixtures of one image into those of the next, so that a jump of them is not felt as a knock."""

from collections.abc import Sequence

from haptigraph.haptics.force.fixture import Fixture, elastic_mj, force_n
from haptigraph.robot.pose import Vec3

__all__ = ["BLEND_MS", "FixtureBlend"]

BLEND_MS = 20.0
"""Less than the interval between images at 30 per second."""
REPLACED_BELOW = 0.1  # fixtures of a smaller weight are replaced at once
BLEND_NS = round(BLEND_MS * 1e6)


class _Layer:
    """The fixtures of one image, and their weight when the next ones came."""

    def __init__(self, fixtures: Sequence[Fixture], weight: float) -> None:
        self.fixtures, self.weight = fixtures, weight


class FixtureBlend:
    """A weighted sum of fixtures; the weight of the newest grows to 1 within `BLEND_MS`."""

    def __init__(self) -> None:
        self._fading: list[_Layer] = []
        self._newest: Sequence[Fixture] = ()
        self._since_ns: int | None = None
        """When the newest fixtures came; None: they have replaced all others."""

    def take(self, fixtures: Sequence[Fixture], now_ns: int) -> None:
        """Take the fixtures of the newest image."""
        if not fixtures and not self._newest:
            return
        weight = self._weight(now_ns)
        if weight >= REPLACED_BELOW:
            for layer in self._fading:
                layer.weight *= 1.0 - weight
            self._fading = [layer for layer in self._fading if layer.weight > 0]
            self._fading.append(_Layer(self._newest, weight))
            self._since_ns = now_ns
        self._newest = fixtures

    def force_n(self, position_mm: Vec3, velocity_mm_s: Vec3, now_ns: int) -> Vec3:
        """Return the force on a hand [N]."""
        x = y = z = 0.0
        for weight, fixture in self._weighted(now_ns):
            fx, fy, fz = force_n(fixture, position_mm, velocity_mm_s)
            x, y, z = x + weight * fx, y + weight * fy, z + weight * fz
        return x, y, z

    def elastic_mj(self, position_mm: Vec3, now_ns: int) -> float:
        """Return the energy that a hand has stored in the fixtures [mJ]."""
        return sum(
            [weight * elastic_mj(fixture, position_mm) for weight, fixture in self._weighted(now_ns)], 0.0
        )

    def limit_n(self, now_ns: int) -> float:
        """Return the largest limit of the fixtures that act [N]."""
        return max([fixture.limit_n for _, fixture in self._weighted(now_ns)], default=0.0)

    def _weight(self, now_ns: int) -> float:
        """Return the weight of the newest fixtures."""
        return 1.0 if self._since_ns is None else min((now_ns - self._since_ns) / BLEND_NS, 1.0)

    def _weighted(self, now_ns: int) -> list[tuple[float, Fixture]]:
        weight = self._weight(now_ns)
        if weight >= 1.0:
            self._fading, self._since_ns = [], None
            return [(1.0, fixture) for fixture in self._newest]
        fading = [
            (layer.weight * (1.0 - weight), fixture) for layer in self._fading for fixture in layer.fixtures
        ]
        return [*fading, *[(weight, fixture) for fixture in self._newest]]
