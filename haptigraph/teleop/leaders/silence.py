"""Find the topics of leaders on a ROS 2 network, and notice that one has fallen silent."""

import threading

from haptigraph.clock import Clock
from haptigraph.errors import DeviceError
from haptigraph.ros2.node import Node

__all__ = ["Silence", "topics_found"]

DISCOVERY_NS = 2_000_000_000
"""Publishers may take this long to be found after the start."""
SEARCH_S = 1.0


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


def topics_found() -> dict[str, str]:
    """Return the topics that are published on the network now, and the DDS type of each."""
    node = Node()
    threading.Event().wait(SEARCH_S)
    published = node.published()
    node.close()
    return published
