"""The loop's time: monotonic integer nanoseconds.

A recording stores the offset from these stamps to wall-clock time.
"""

import math
import time
from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np

__all__ = ["Clock", "Cycles", "MonotonicClock", "VirtualClock", "lateness_ms", "offset_ns"]


class Clock(Protocol):
    """Return the time and wait for it."""

    def now_ns(self) -> int:
        """Return the current time [ns]."""
        ...

    def wait_until(self, stamp_ns: int) -> None:
        """Return no earlier than `stamp_ns`; at once if that has passed."""
        ...


class MonotonicClock:
    """The machine's monotonic clock, shared by all processes on it."""

    def now_ns(self) -> int:
        """Return the current time [ns]."""
        return time.monotonic_ns()

    def wait_until(self, stamp_ns: int) -> None:
        """Sleep until `stamp_ns` [ns]."""
        while (left_ns := stamp_ns - time.monotonic_ns()) > 0:
            time.sleep(left_ns / 1e9)


class VirtualClock:
    """A clock that jumps to whatever is waited for: for runs as fast as possible, and for tests."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Return the current time [ns]."""
        return self._now_ns

    def wait_until(self, stamp_ns: int) -> None:
        """Jump to `stamp_ns` [ns], but never back."""
        self._now_ns = max(self._now_ns, stamp_ns)


class Cycles:
    """The cycles of a loop, the first one at once; those that one which comes too late misses are left out.

    Args:
        clock: Real or virtual time.
        period_ns: Of a cycle.
    """

    def __init__(self, clock: Clock, period_ns: int) -> None:
        self._clock, self._period_ns = clock, period_ns
        self._due_ns = clock.now_ns()
        self.missed = 0
        """Cycles that were left out, since the start."""

    def wait(self) -> tuple[int, int]:
        """Wait for the next cycle; return the time, and how late it is [ns]."""
        self._clock.wait_until(self._due_ns)
        now_ns = self._clock.now_ns()
        late_ns = now_ns - self._due_ns
        missed = late_ns // self._period_ns
        self.missed += missed
        self._due_ns += (missed + 1) * self._period_ns
        return now_ns, late_ns


def offset_ns(other_ns: Callable[[], int], clock: Clock) -> int:
    """Measure how far another clock is ahead of a run's: add the result to a stamp for the other's time.

    Uses the fastest of a few readings, so that preemption between two of them does no harm.
    """
    readings = []
    for _ in range(5):
        before_ns, reading_ns, after_ns = clock.now_ns(), other_ns(), clock.now_ns()
        readings.append((after_ns - before_ns, reading_ns - (before_ns + after_ns) // 2))
    return min(readings)[1]


def lateness_ms(late_ns: Sequence[int]) -> tuple[float, float, float]:
    """Return p50, p99 and p99.9 of how late the cycles of a loop began [ms]; nan without any."""
    if not late_ns:
        return math.nan, math.nan, math.nan
    p50_ms, p99_ms, p999_ms = (np.percentile(late_ns, (50, 99, 99.9)) / 1e6).tolist()
    return p50_ms, p99_ms, p999_ms
