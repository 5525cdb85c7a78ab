"""What passes between a robot's process and the program that started it."""

from msgspec import Struct

from haptigraph.messages import HandState
from haptigraph.robot.interface import RobotReading, StateCommand
from haptigraph.teleop.motion import HandMotion, TeleopSettings

__all__ = ["Input", "MotionStatus", "Report"]


class Input(Struct, array_like=True):
    """One message to the robot's process."""

    is_switched_on: bool
    """The enable switch."""
    hand: HandMotion | None = None
    settings: TeleopSettings | None = None
    request: StateCommand | None = None


class Report(Struct, array_like=True):
    """What the robot's process reports every few cycles; the first one says that the robot is open."""

    is_moving: bool
    reasons: tuple[str, ...]
    """Why it is held."""
    reading: RobotReading | None
    """The newest."""
    readings: list[RobotReading]
    """The newest pose of each cycle since the report before, if there was a new one; oldest first."""
    late_ns: list[int]
    """How long after its time each cycle since the report before began."""
    missed_deadlines: int = 0
    """Cycles that were left out because the one before came too late, since the start."""
    stamp_ns: int = 0
    """When the last of these cycles began."""
    hand: HandState | None = None
    error: str = ""
    """Why the robot cannot be opened, or what failed last."""


class MotionStatus(Struct, frozen=True):
    """Whether a robot moves, and if not, why."""

    is_moving: bool
    reasons: tuple[str, ...]
    """Why it is held; empty if it moves."""
    is_switched_on: bool
    reading: RobotReading | None
    """The newest."""
    rate_hz: float
    """Cycles per second of the loop, over the last seconds."""
    missed_deadlines: int
    """Since the start."""
    late_p50_ms: float
    """How long after its time a cycle begins: median over the last seconds; nan before the first."""
    late_p99_ms: float
    late_p999_ms: float
    error: str = ""
    """What failed last; empty: nothing."""
