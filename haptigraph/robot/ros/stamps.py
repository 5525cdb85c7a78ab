"""Convert the stamps of a robot's messages, UTC of its machine, to the run's clock.

The first message decides. Stamps within `MAX_AGE_NS` of their arrival are taken as they are, so that a
constant latency counts as age; the machines' clocks must agree as well as the ages that matter. Stamps of
another clock, hours off, are shifted by the smallest (arrival - stamp) of the last messages: no message
arrives before it was sent, and the fastest of many was hardly delayed. Their constant latency remains
unknown. Without stamps, the time of arrival counts.
"""

import time
from collections import deque
from collections.abc import Callable
from typing import Literal

from haptigraph.clock import Clock, offset_ns

__all__ = ["MAX_AGE_NS", "MAX_AHEAD_NS", "StampClock"]

MAX_AGE_NS = 1_000_000_000
MAX_AHEAD_NS = 20_000_000
WINDOW = 300  # messages


class StampClock:
    """Stamps of one topic on the run's clock.

    Args:
        clock: The run's.
        utc_ns: Returns UTC of this machine [ns].
    """

    def __init__(self, clock: Clock, utc_ns: Callable[[], int] = time.time_ns) -> None:
        self._clock, self._utc_ns = clock, utc_ns
        self._kind: Literal["utc", "other", "none"] | None = None
        self._offsets_ns: deque[int] = deque(maxlen=WINDOW)
        self._last = (-1, -1)
        self.note = ""
        """What is unusual about the stamps; empty: nothing."""

    def to_run_clock(self, stamp_ns: int, received_ns: int) -> int:
        """Return when a message was measured [ns] on the run's clock, not after it was received.

        A stamp that does not advance gives the same time again, so that frozen stamps grow old.

        Args:
            stamp_ns: Its stamp [ns], UTC of the robot's machine; 0: none.
            received_ns: When it was received [ns], on the run's clock.

        Raises:
            ValueError: If the stamp is older than the previous one.
        """
        last_ns, converted_ns = self._last
        if stamp_ns == last_ns and stamp_ns:
            return converted_ns
        if stamp_ns < last_ns:
            raise ValueError(f"a stamp {(last_ns - stamp_ns) / 1e6:.1f} ms older than the previous one")
        age_ns = received_ns - (stamp_ns - offset_ns(self._utc_ns, self._clock))
        if self._kind is None:
            self._choose(stamp_ns, age_ns)
        if self._kind == "none":
            return received_ns
        if self._kind == "other":
            self._offsets_ns.append(age_ns)
            age_ns -= min(self._offsets_ns)
        self._last = stamp_ns, received_ns - max(age_ns, 0)
        return self._last[1]

    def _choose(self, stamp_ns: int, age_ns: int) -> None:
        if not stamp_ns:
            self._kind = "none"
            self.note = "messages have no stamp; their time of arrival is used, and latency is unknown"
        elif -MAX_AHEAD_NS <= age_ns <= MAX_AGE_NS:
            self._kind = "utc"
        else:
            self._kind = "other"
            when = "past" if age_ns > 0 else "future"
            self.note = (
                f"stamps are {abs(age_ns) / 1e9:.1f} s in the {when}; they are shifted to the time of "
                "arrival, and constant latency is unknown; synchronise the machines' clocks (NTP, PTP)"
            )
