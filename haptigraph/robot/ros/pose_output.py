"""Command poses on a topic, and hold."""

import time

from haptigraph.clock import Clock, offset_ns
from haptigraph.errors import DeviceError
from haptigraph.robot.interface import RobotReading
from haptigraph.robot.pose import ToolPose, angle_deg
from haptigraph.robot.ros.poses import as_message
from haptigraph.ros2.motion_types import PoseStamped
from haptigraph.ros2.node import Node
from haptigraph.ros2.types import Header, Time

__all__ = ["PoseOutput"]

NEAR_MM, NEAR_DEG = 2.0, 5.0  # a robot that follows lags by less, at 10 mm/s and 30 deg/s
FRESH_NS = 100_000_000
HOLD_NS = 500_000_000


class PoseOutput:
    """Publish geometry_msgs/PoseStamped.

    Args:
        node: The publishing node.
        topic: ROS name of the topic.
        clock: The run's.
    """

    def __init__(self, node: Node, topic: str, clock: Clock) -> None:
        self._topic, self._clock = topic, clock
        self._publisher = node.publisher(topic, PoseStamped)
        self._commanded: ToolPose | None = None
        self._held_ns: int | None = None

    def move(self, pose: ToolPose, stamp_ns: int, frame_id: str) -> None:
        """Command a pose that is due at a time of the run's clock.

        Raises:
            DeviceError: If it cannot be sent, or nobody receives it.
            ValueError: If it is not a pose.
        """
        if not pose.is_finite:
            raise ValueError(f"{pose} is not a pose")
        self._commanded, self._held_ns = pose, None
        self._send(pose, stamp_ns, frame_id)

    def hold(self, stamp_ns: int, reading: RobotReading, frame_id: str) -> None:
        """Command the robot to stay.

        The calls of `HOLD_NS` send the same pose, so that a lost message does no harm; later ones nothing, so
        that another program can take over. It is the last commanded pose, which was within the limits; or the
        measured one, if the robot does not follow. A robot that was not moved, or is not enabled, receives
        nothing, and what it was commanded is forgotten: when it is enabled again, it must not jump to an old
        pose.

        Raises:
            DeviceError: If it cannot be sent, or nobody receives it.
        """
        now_ns = self._clock.now_ns()
        is_over = self._held_ns is not None and now_ns - self._held_ns > HOLD_NS
        if is_over or (reading.operating is not None and reading.operating.state != "ENABLED"):
            self._commanded = None
        if self._commanded is None:
            return
        if self._held_ns is None:
            self._held_ns = now_ns
            self._commanded = self._stay_at(self._commanded, reading)
        self._send(self._commanded, stamp_ns, frame_id)

    def _stay_at(self, commanded: ToolPose, reading: RobotReading) -> ToolPose:
        measured = reading.pose
        if measured is None or self._clock.now_ns() - reading.stamp_ns > FRESH_NS:
            return commanded
        away_mm = max(abs(a - b) for a, b in zip(commanded.position_mm, measured.position_mm, strict=True))
        is_near = away_mm <= NEAR_MM and angle_deg(commanded, measured) <= NEAR_DEG
        return commanded if is_near else measured

    def _send(self, pose: ToolPose, stamp_ns: int, frame_id: str) -> None:
        utc_ns = stamp_ns + offset_ns(time.time_ns, self._clock)
        try:
            self._publisher.send(PoseStamped(Header(Time.from_ns(utc_ns), frame_id), as_message(pose)))
        except OSError as error:
            raise DeviceError(f"{self._topic} cannot be published ({error})") from None
        if not self._publisher.has_subscribers:
            raise DeviceError(f"nobody subscribes to {self._topic}; the robot's node is not there")
