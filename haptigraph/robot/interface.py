"""The contract of every robot: what it measures, what it is commanded, in which state it is.

Frames: the robot's base, millimetres. Names of the operating states follow CRTK
(https://github.com/collaborative-robotics/documentation/wiki/Robot-API-status). `opening.ROBOTS` lists the
classes.
"""

from typing import Literal, Protocol, TypeAlias, get_args, runtime_checkable

from msgspec import Struct

from haptigraph.robot.pose import ToolPose, Vec3

__all__ = ["STATE_COMMANDS", "Operating", "OperatingState", "Robot", "RobotReading", "StateCommand"]

OperatingState: TypeAlias = Literal["DISABLED", "ENABLED", "PAUSED", "FAULT"]
StateCommand: TypeAlias = Literal["enable", "disable", "pause", "resume", "home"]
STATE_COMMANDS: tuple[StateCommand, ...] = get_args(StateCommand)


class Operating(Struct, frozen=True):
    """A robot's operating state."""

    state: OperatingState
    is_homed: bool
    is_busy: bool
    """Whether it is moving by itself, for instance while homing."""


class RobotReading(Struct, frozen=True):
    """The newest measurements of a robot. What it has not reported is None."""

    stamp_ns: int
    """When the pose was measured, on the run's clock."""
    received_ns: int
    """When the pose arrived here, on the run's clock; 0: never."""
    pose: ToolPose | None = None
    """The tool in the robot's base."""
    operating: Operating | None = None
    force_n: Vec3 | None = None
    """Force on the tool, in the robot's base."""
    number: int = 0
    """Count of received poses."""
    problems: tuple[str, ...] = ()
    """What was rejected or is unusual so far, a sentence each."""


@runtime_checkable
class Robot(Protocol):
    """Read and move one robot. Called by one thread only; no call blocks."""

    def read(self) -> RobotReading:
        """Return the newest measurements."""
        ...

    def move(self, pose: ToolPose, stamp_ns: int) -> None:
        """Command the pose that is due at a time of the run's clock.

        Raises:
            DeviceError: If it cannot be sent.
        """
        ...

    def hold(self, stamp_ns: int) -> None:
        """Command the robot to stay where it is; called in every cycle in which it is held.

        Only the first of these calls decides where that is, so that it does not creep.

        Raises:
            DeviceError: If it cannot be sent.
        """
        ...

    def request(self, command: StateCommand) -> None:
        """Ask for another operating state; `read` reports when it is reached."""
        ...

    def close(self) -> None:
        """Hold the robot if it was moved, and disconnect. May be called twice."""
        ...
