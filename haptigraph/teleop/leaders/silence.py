"""Notice that the topic of a leader has fallen silent."""

from haptigraph.clock import Clock
from haptigraph.errors import DeviceError

__all__ = ["Silence"]

DISCOVERY_NS = 2_000_000_000
"""Publishers may take this long to be found after the start."""


class Silence:
    """Watch one topic. `heard` and `reject` may be called in another thread than `check`.

    Args:
        topic: For the message.
        limit_ms: The topic is silent after this time without a valid message.
        clock: Measures that time.
    """

    def __init__(self, topic: str, limit_ms: float, clock: Clock) -> None:
        self._topic, self._limit_ms, self._clock = topic, limit_ms, clock
        self._heard_ns = clock.now_ns() + DISCOVERY_NS
        self._problem = ""

    def heard(self) -> None:
        """Note a valid message."""
        self._heard_ns, self._problem = self._clock.now_ns(), ""

    def reject(self, problem: str) -> None:
        """Note an invalid message, and why it is."""
        self._problem = f" ({problem})"

    def check(self) -> None:
        """Do nothing while valid messages arrive.

        Raises:
            DeviceError: If there was none for too long.
        """
        if self._clock.now_ns() - self._heard_ns > self._limit_ms * 1e6:
            raise DeviceError(f"no valid message on {self._topic} for {self._limit_ms:g} ms{self._problem}")
