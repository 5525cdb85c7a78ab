"""How a run went, as a machine sees it: counts, faults, and how long every stage took.

Turns durations into percentiles, in little memory however long the run is. Knows stages by name alone.
"""

import math
from collections import Counter

import numpy as np
from msgspec import Struct, field

__all__ = ["STAGES", "Durations", "RunReport"]

STAGES = ("read", "perceive", "build_scene", "reason", "render", "step")


class Durations:
    """Percentiles of many durations in little memory: a histogram with 1 % wide bins, 100 ns to 1000 s."""

    def __init__(self) -> None:
        self._counts = np.zeros(2400, np.int64)

    def add(self, duration_ns: int) -> None:
        """Count one duration."""
        place = int(math.log(max(duration_ns, 100) / 100, 1.01))
        self._counts[min(place, len(self._counts) - 1)] += 1

    def percentile_ms(self, percent: float) -> float:
        """Return a percentile [ms]; nan if nothing was counted."""
        total = int(self._counts.sum())
        if total == 0:
            return float("nan")
        place = int(np.searchsorted(np.cumsum(self._counts), total * percent / 100))
        return float(100 * 1.01 ** (place + 0.5) / 1e6)


class RunReport(Struct):
    """How a run went, as a machine sees it."""

    steps: int = 0
    duration_s: float = 0.0
    """On the run's clock, from the first to the last step."""
    wall_s: float = 0.0
    overruns: int = 0
    """Images that were due before the loop was ready for them."""
    skipped: int = 0
    """Images of a live source that the loop was too slow to see."""
    dropped: int = 0
    """Items that sinks could not keep."""
    faults: Counter[str] = field(default_factory=Counter)
    """How often each fault came."""
    stages: dict[str, Durations] = field(default_factory=lambda: {name: Durations() for name in STAGES})
    """Duration of reading an image, of each stage, and of the whole "step"."""
    ended: str = "source ended"
    """Why the run ended."""

    @property
    def rate_hz(self) -> float:
        """Steps per second of wall-clock time."""
        return self.steps / self.wall_s if self.wall_s > 0 else 0.0
