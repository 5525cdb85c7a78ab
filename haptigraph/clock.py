"""Time, as the loop sees it: integer nanoseconds that never run backwards.

Knows nothing of dates; a recording keeps the one offset that turns stamps into wall-clock time.
"""

import time
from collections.abc import Callable
from typing import Protocol

__all__ = ["Clock", "MonotonicClock", "VirtualClock", "offset_ns"]


class Clock(Protocol):
    """Tell the time and wait for it."""

    def now_ns(self) -> int:
        """Return the present [ns]."""
        ...

    def wait_until(self, stamp_ns: int) -> None:
        """Return no earlier than `stamp_ns`; at once if that has passed."""
        ...


class MonotonicClock:
    """The machine's monotonic clock, shared by all processes on it."""

    def now_ns(self) -> int:
        """Return the present [ns]."""
        return time.monotonic_ns()

    def wait_until(self, stamp_ns: int) -> None:
        """Sleep until `stamp_ns` [ns]."""
        while (left_ns := stamp_ns - time.monotonic_ns()) > 0:
            time.sleep(left_ns / 1e9)


class VirtualClock:
    """A clock that jumps to whatever is waited for: runs as fast as possible, and tests."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Return the present [ns]."""
        return self._now_ns

    def wait_until(self, stamp_ns: int) -> None:
        """Jump to `stamp_ns` [ns]; never back."""
        self._now_ns = max(self._now_ns, stamp_ns)


def offset_ns(other_ns: Callable[[], int], clock: Clock) -> int:
    """Measure how far another clock is ahead of a run's: what to add to a stamp to get the other's time.

    Takes the quickest of a few readings, so that being held up between two of them does no harm.
    """
    readings = []
    for _ in range(5):
        before_ns, there_ns, after_ns = clock.now_ns(), other_ns(), clock.now_ns()
        readings.append((after_ns - before_ns, there_ns - (before_ns + after_ns) // 2))
    return min(readings)[1]
