"""Publish a run to ROS 2, and let a joystick on that network steer the phantom."""

from typing import Any

from haptigraph.bridges.bridge import RunContext
from haptigraph.bridges.diagnostics import RunDiagnostics
from haptigraph.bridges.ros2_messages import StepMessages
from haptigraph.messages import Capture, Step
from haptigraph.ros2.geometry_types import JointState, PoseWithCovarianceStamped, TFMessage
from haptigraph.ros2.node import Node, checked_topic
from haptigraph.ros2.types import DiagnosticArray, Joy, PointStamped
from haptigraph.teleop.leaders.joy import JoySteering

__all__ = ["TOPICS", "Ros2Link"]

TOPICS: dict[str, Any] = {
    "state": DiagnosticArray,
    "graph": DiagnosticArray,
    "theta": JointState,
    "needle_tip": PointStamped,
    "needle": PoseWithCovarianceStamped,
    "touch": JointState,
    "/tf": TFMessage,
    "/tf_static": TFMessage,
    "/diagnostics": DiagnosticArray,
}
"""What is published, below the namespace unless the name begins with a slash."""

MAX_PROBLEMS = 10


class Ros2Link:
    """A ROS 2 node that publishes a run.

    Args:
        namespace: Of the topics; empty: haptigraph.
        run: The run to publish.

    Raises:
        BadInput: If the namespace is not valid, or the network cannot be joined.
        MissingExtra: If cyclonedds is not installed.
    """

    def __init__(self, namespace: str, run: RunContext) -> None:
        self._problems: list[str] = []
        root = checked_topic(namespace or "haptigraph")
        name = root.strip("/")
        self._messages = StepMessages(name, run)
        self._run_diagnostics = RunDiagnostics(name, run.info.utc_offset_ns)
        self._node = Node()
        self._publish = {
            topic: self._node.publisher(topic if topic.startswith("/") else f"{root}/{topic}", message_type)
            for topic, message_type in TOPICS.items()
        }
        static = self._messages.of_static_frames(run)
        if static is not None:
            self._publish["/tf_static"].send(static)
        if run.teleop is not None:
            self._node.subscribe("/joy", Joy, JoySteering(run.teleop.put, run.clock).take, self._reject)

    def send_step(self, capture: Capture, step: Step) -> None:
        """Publish one step."""
        for topic, message in self._messages.of_step(capture, step):
            self._publish[topic].send(message)
        summary = self._run_diagnostics.add(capture, step)
        if summary is not None:
            self._publish["/diagnostics"].send(summary)

    def send_output(self, stamp_ns: int, amplitude: float, frequency_hz: float) -> None:
        """Publish the haptic output from `stamp_ns` on."""
        self._publish["touch"].send(self._messages.of_output(stamp_ns, amplitude))

    def take_problems(self) -> tuple[str, ...]:
        """Return the problems of received messages."""
        problems, self._problems = tuple(self._problems), []
        return problems

    def close(self) -> None:
        """Leave the network."""
        self._node.close()

    def _reject(self, problem: str) -> None:
        if len(self._problems) < MAX_PROBLEMS:
            self._problems.append(f"rejected a message on /joy: {problem}")
