"""Publish a run to ROS 2, and let a joystick on that network steer the phantom.

Stamps are the wall-clock time at which the image was taken; units follow REP 103 (metres, radians).
"""

import math
from typing import Any

import msgspec

from haptigraph.bridges.bridge import RunContext
from haptigraph.bridges.diagnostics import RunDiagnostics
from haptigraph.geometry import Point as EyePoint
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
from haptigraph.teleop.leaders.joy import JoySteering

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
"""Published below the namespace, besides /diagnostics."""

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
        self._utc_offset_ns = run.info.utc_offset_ns
        self._problems: list[str] = []
        root = checked_topic(namespace or "haptigraph")
        self._node = Node()
        self._publish = {
            name: self._node.publisher(f"{root}/{name}", message_type)
            for name, message_type in TOPICS.items()
        }
        self._run_diagnostics = RunDiagnostics(root.strip("/"), self._utc_offset_ns)
        self._diagnostics = self._node.publisher("/diagnostics", DiagnosticArray)
        if run.teleop is not None:
            self._node.subscribe("/joy", Joy, JoySteering(run.teleop.put, run.clock).take, self._reject)

    def send_step(self, capture: Capture, step: Step) -> None:
        """Publish one step; needle tip and theta only if they are known."""
        self._publish["state"].send(String(step.conclusion.state))
        self._publish["graph"].send(String(msgspec.json.encode(step.graph).decode()))
        tip = step.observation.found.get("needle_tip")
        if isinstance(tip, EyePoint):
            at_m = (length_mm / 1e3 for length_mm in (*tip.at_mm, tip.z_mm))
            header = Header(Time.from_ns(step.stamp_ns + self._utc_offset_ns), EYE_FRAME)
            self._publish["needle_tip"].send(PointStamped(header, Point(*at_m)))
        theta_deg = step.graph.measures.get("theta_deg")
        if theta_deg is not None:
            self._publish["theta"].send(Float64(math.radians(theta_deg)))
        summary = self._run_diagnostics.add(capture, step)
        if summary is not None:
            self._diagnostics.send(summary)

    def send_output(self, stamp_ns: int, amplitude: float, frequency_hz: float) -> None:
        """Publish the haptic output from now on."""
        self._publish["touch"].send(JoyFeedback(RUMBLE, 0, amplitude))

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
