"""What passes between a force device's process and the run."""

from msgspec import Struct

from haptigraph.haptics.force.fixture import Fixture
from haptigraph.haptics.force.interface import ForceCapabilities
from haptigraph.messages import ForceSample
from haptigraph.robot.pose import Vec3

__all__ = ["ForceInput", "ForceReport", "ForceStatus"]


class ForceInput(Struct, array_like=True):
    """The fixtures of one step."""

    fixtures: tuple[Fixture, ...]
    """In the eye frame; none: the hand is let go."""
    tip_mm: Vec3
    """The tip in the image, eye frame."""
    stamp_ns: int
    """When the image was taken."""
    scale: float
    """Ratio of tip motion to hand motion."""


class ForceReport(Struct, array_like=True):
    """What the process reports 100 times a second; the first one says that the device is open."""

    samples: list[ForceSample]
    """Since the report before, oldest first."""
    late_ns: list[int]
    """How long after its time each cycle since the report before began."""
    missed: int = 0
    """Cycles that were left out because the one before came too late, since the start."""
    stamp_ns: int = 0
    """When the last of these cycles began."""
    problems: tuple[str, ...] = ()
    """Why force was released since the report before, a sentence each."""
    capabilities: ForceCapabilities | None = None
    """In the first report."""
    error: str = ""
    """Why the device cannot be opened, or failed; the process then ends."""


class ForceStatus(Struct, frozen=True):
    """How the loop of a force device runs."""

    rate_hz: float
    """Cycles per second, over the last seconds."""
    missed: int
    """Cycles left out, since the start."""
    late_p50_ms: float
    """How long after its time a cycle begins: median over the last seconds; nan before the first."""
    late_p99_ms: float
    late_p999_ms: float
    releases: int
    """How often force was released because of a problem, since the start."""
