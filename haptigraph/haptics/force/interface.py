"""The contract of every device with force: where the hand is, and how it is pushed.

Frame: x to the hand's right, y up, z towards the operator; parallel to the eye frame. Millimetres, newtons.
"""

from typing import Protocol, runtime_checkable

from msgspec import Struct

from haptigraph.robot.pose import Vec3

__all__ = ["ForceCapabilities", "ForceDevice", "HandReading"]


class HandReading(Struct, frozen=True):
    """Where the hand is."""

    stamp_ns: int
    """When it was measured, on the clock of the loop that calls the device."""
    position_mm: Vec3
    velocity_mm_s: Vec3
    engaged: bool
    """Whether the operator holds the clutch; if not, the device neither pushes nor moves a tool."""


class ForceCapabilities(Struct, frozen=True):
    """What a device can do."""

    max_force_n: float
    """Force that it can exert continuously in any direction."""
    rate_hz: float
    """Exchanges per second that it sustains."""
    max_speed_mm_s: float
    """Speed of the hand up to which passivity is guaranteed; above it the force is released."""
    damping_n_s_per_mm: float = 0.0
    """Its own mechanical damping, at least; 0: unknown."""
    delay_ms: float = 0.0
    """Upper bound of the delay from measuring the hand to pushing it, beyond one exchange. The delay may vary
    below it. 0: the hand is measured, and the force set, at the call of `exchange`."""
    axes: int = 3
    """Number of axes along which it pushes."""
    holds_ms: float | None = None
    """It lets go by itself after this time without a call; None: it does not."""
    limitations: str = ""
    """What it cannot do, in one sentence."""


@runtime_checkable
class ForceDevice(Protocol):
    """Push one hand. Called by one thread only."""

    capabilities: ForceCapabilities
    """What the device can do; known once it is open."""

    def exchange(self, force_n: Vec3) -> HandReading:
        """Push the hand with this force until the next call, and return where the hand is.

        The first call passes zero, which ends whatever the device did before.

        Raises:
            DeviceError: If the device fails.
        """
        ...

    def close(self) -> None:
        """Let go and release the device. May be called twice.

        Raises:
            DeviceError: If it may still push.
        """
        ...
