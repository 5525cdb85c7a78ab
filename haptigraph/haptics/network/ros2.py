"""A device at the other end of a ROS 2 network: sensor_msgs/JoyFeedback for the joy node of ROS.

The joy node plays each message for one second on both motors, so the guard renews it before that. A watchdog
process publishes silence when the run dies.
"""

from haptigraph.errors import DeviceError
from haptigraph.messages import Capabilities

__all__ = ["DISCOVERY_S", "Ros2Device"]

DEFAULT_TOPIC = "joy/set_feedback"
DISCOVERY_S = 1.0  # subscribers announce themselves within this time


class Ros2Device:
    """Publish every amplitude as the intensity of a rumble. Opening waits briefly for a subscriber.

    Args:
        topic: The topic; joy/set_feedback if empty.

    Raises:
        BadInput: If it is not a valid topic, or the network cannot be joined.
        MissingExtra: If cyclonedds is not installed.
    """

    capabilities = Capabilities(
        amplitude_levels=65535,
        frequency_range_hz=None,
        shortest_on_ms=50.0,
        max_rate_hz=20.0,
        holds_ms=1000.0,
        limitations="The subscriber chooses the frequency; the joy node turns both motors alike.",
    )

    def __init__(self, topic: str = "") -> None:
        # Imported here, so that the capabilities are available without the extra.
        from haptigraph.ros2 import types  # noqa: PLC0415
        from haptigraph.ros2.node import Node  # noqa: PLC0415

        self._types = types
        self._topic, self._closed = topic or DEFAULT_TOPIC, False
        self._node = Node()
        self._publisher = self._node.publisher(self._topic, types.JoyFeedback)
        self._node.await_subscribers(DISCOVERY_S)

    @staticmethod
    def found() -> dict[str, str]:
        """Return the subscribers to haptic output: the device argument and the ROS domain of each."""
        from haptigraph.ros2.node import Node, domain_id  # noqa: PLC0415
        from haptigraph.ros2.topics import topics_found  # noqa: PLC0415

        subscribed = topics_found(Node.subscribed)
        where = f"subscribed to on ROS domain {domain_id()}"
        return {f"ros2:{topic}": where for topic, kind in subscribed.items() if kind.endswith("JoyFeedback_")}

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Publish one amplitude, even without subscribers.

        Raises:
            DeviceError: If nobody subscribes, or it could not be published.
        """
        self._publish(amplitude)
        if not self._publisher.has_subscribers:
            raise DeviceError(f"nobody subscribes to ros2:{self._topic} (ROS domain {self._node.domain})")

    def close(self) -> None:
        """Publish silence and leave the network.

        Raises:
            DeviceError: If it could not be published.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self._publish(0.0)
        finally:
            self._node.close()

    def _publish(self, amplitude: float) -> None:
        try:
            self._publisher.send(self._types.JoyFeedback(self._types.RUMBLE, 0, amplitude))
        except OSError as error:
            raise DeviceError(f"ros2:{self._topic} cannot be published ({error})") from None
