"""Tell a ROS 2 network what a run sees and concludes, and let a joystick there steer the phantom.

Stamps are when the image was taken, in wall-clock time; places and angles follow REP 103 (metres, radians).
"""

import math
from typing import Any

import msgspec

from haptigraph.bridges.bridge import Run
from haptigraph.bridges.diagnostics import Diagnosis
from haptigraph.bridges.joy import JoySteering
from haptigraph.geometry import Point as Place
from haptigraph.messages import Capture, Step
from haptigraph.ros2.node import Node, checked_topic
from haptigraph.ros2.types import (
    RUMBLE,
    DiagnosticArray,
    Float64,
    Header,
    Joy,
    JoyFeedback,
    Point,
    PointStamped,
    String,
    Time,
)

__all__ = ["EYE_FRAME", "TOPICS", "Ros2Link"]

EYE_FRAME = "haptigraph_eye"
"""Origin: the globe's centre; x to the surgeon's right, y up in the un-mirrored image, z out of it; m."""

TOPICS: dict[str, Any] = {
    "state": String,
    "graph": String,
    "needle_tip": PointStamped,
    "theta": Float64,
    "touch": JoyFeedback,
}
"""Published below the namespace; /diagnostics besides."""


class Ros2Link:
    """A ROS 2 node that publishes a run.

    Args:
        namespace: Of the topics; haptigraph if empty.
        run: What is told.

    Raises:
        BadInput: If the namespace is none, or the network cannot be joined.
        MissingExtra: If cyclonedds is not installed.
    """

    def __init__(self, namespace: str, run: Run) -> None:
        self._utc_offset_ns = run.info.utc_offset_ns
        self._problems: list[str] = []
        space = checked_topic(namespace or "haptigraph")
        self._node = Node()
        self._publish = {
            name: self._node.publisher(f"{space}/{name}", message_type)
            for name, message_type in TOPICS.items()
        }
        self._diagnosis = Diagnosis(space.strip("/"), self._utc_offset_ns)
        self._diagnostics = self._node.publisher("/diagnostics", DiagnosticArray)
        if (teleop := getattr(run.source, "teleop", None)) is not None:
            self._node.subscribe("/joy", Joy, JoySteering(teleop.put, run.clock).take, self._refuse)

    def send(self, capture: Capture, step: Step) -> None:
        """Publish one step; needle and theta only where there is one."""
        self._publish["state"].send(String(step.conclusion.state))
        self._publish["graph"].send(String(msgspec.json.encode(step.graph).decode()))
        tip = step.observation.found.get("needle_tip")
        if isinstance(tip, Place):
            x_mm, y_mm = tip.at_mm
            header = Header(Time.from_ns(step.stamp_ns + self._utc_offset_ns), EYE_FRAME)
            self._publish["needle_tip"].send(PointStamped(header, Point(x_mm / 1e3, y_mm / 1e3, 0.0)))
        theta_deg = step.graph.measures.get("theta_deg")
        if theta_deg is not None:
            self._publish["theta"].send(Float64(math.radians(theta_deg)))
        summary = self._diagnosis.add(capture, step)
        if summary is not None:
            self._diagnostics.send(summary)

    def felt(self, stamp_ns: int, amplitude: float, frequency_hz: float) -> None:
        """Publish what the hand feels from now on."""
        self._publish["touch"].send(JoyFeedback(RUMBLE, 0, amplitude))

    def take_problems(self) -> tuple[str, ...]:
        """Return what was wrong with messages that came."""
        problems, self._problems = tuple(self._problems), []
        return problems

    def close(self) -> None:
        """Leave the network."""
        self._node.close()

    def _refuse(self, problem: str) -> None:
        if len(self._problems) < 10:
            self._problems.append(f"refused from /joy: {problem}")
