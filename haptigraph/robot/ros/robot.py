"""What robots of every kind on a ROS 2 network share: how they are commanded, held and left."""

from abc import ABC, abstractmethod

from haptigraph.clock import Clock
from haptigraph.robot.interface import RobotReading
from haptigraph.robot.pose import ToolPose
from haptigraph.robot.ros.pose_input import PoseInput
from haptigraph.robot.ros.pose_output import PoseOutput
from haptigraph.ros2.node import Node

__all__ = ["DISCOVERY_S", "RosRobot"]

DISCOVERY_S = 3.0  # subscribers announce themselves within this time


class RosRobot(ABC):
    """A robot whose poses arrive in `_input`, and which takes poses on a topic.

    Args:
        name: Of the robot, in reports.
        command_topic: ROS name of the topic on which it takes poses.
        clock: The run's.

    Raises:
        BadInput: If the network cannot be joined.
    """

    def __init__(self, name: str, command_topic: str, clock: Clock) -> None:
        self._clock = clock
        self._input = PoseInput(name, clock)
        self._node, self._is_closed = Node(), False
        self._output = PoseOutput(self._node, command_topic, clock)

    @property
    @abstractmethod
    def _frame_id(self) -> str:
        """The frame of the commanded poses."""

    @abstractmethod
    def read(self) -> RobotReading:
        """Return the newest measurements."""

    def move(self, pose: ToolPose, stamp_ns: int) -> None:
        """Publish a pose.

        Raises:
            DeviceError: If it cannot be sent, or nobody receives it.
        """
        self._output.move(pose, stamp_ns, self._frame_id)

    def hold(self, stamp_ns: int) -> None:
        """Command the robot to stay where it was commanded last, or where it is if it did not follow.

        Raises:
            DeviceError: If it cannot be sent, or nobody receives it.
        """
        self._output.hold(stamp_ns, self.read(), self._frame_id)

    def close(self) -> None:
        """Hold, and leave the network.

        Raises:
            DeviceError: If the robot could not be held.
        """
        if self._is_closed:
            return
        self._is_closed = True
        try:
            self.hold(self._clock.now_ns())
        finally:
            self._node.close()
