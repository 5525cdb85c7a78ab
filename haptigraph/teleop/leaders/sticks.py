"""How the sticks of a game controller become hand motion, the same for every way to read them.

Left stick: back moves into the eye (down in the image), right to the surgeon's right. Right stick: back moves
towards the surgeon, out of the picture. The right shoulder button is the clutch, without which nothing moves.
"""

import math

from haptigraph.teleop.motion import HandMotion

__all__ = ["MAX_DURATION_NS", "SPEED_MM_S", "StickTimer", "shaped", "stick_motion"]

DEAD_ZONE = 0.12
SPEED_MM_S = 30.0
MAX_DURATION_NS = 100_000_000
"""A reading is applied for at most this time, so that one after a pause does not move the needle far."""


class StickTimer:
    """Measure for how long a reading of the sticks applies.

    Args:
        now_ns: The time at which the first interval begins.
    """

    def __init__(self, now_ns: int) -> None:
        self._last_ns = now_ns

    def elapsed_s(self, now_ns: int) -> float:
        """Return the time since the last call [s], at most `MAX_DURATION_NS`."""
        elapsed_ns = min(max(now_ns - self._last_ns, 0), MAX_DURATION_NS)
        self._last_ns = now_ns
        return elapsed_ns / 1e9


def stick_motion(
    elapsed_s: float, *, back: float, right: float, towards: float = 0.0, apart: float = 0.0
) -> HandMotion:
    """Return the motion of a hand that has held the sticks for a time, with the clutch pressed.

    Args:
        elapsed_s: The time.
        back: Of the left stick, -1 to 1.
        right: Of the left stick.
        towards: The right stick, towards the surgeon.
        apart: Opens the jaws of forceps, -1 to 1.

    Raises:
        ValueError: If a deflection is not finite.
    """
    distance_mm = SPEED_MM_S * elapsed_s
    along, across, outwards, jaws = (shaped(each) * distance_mm for each in (back, right, towards, apart))
    return HandMotion(True, along, across, jaws, outwards)


def shaped(deflection: float) -> float:
    """Apply a dead zone and a response curve to a deflection: fine near the centre, full at the end.

    Raises:
        ValueError: If it is not finite.
    """
    if not math.isfinite(deflection):
        raise ValueError(f"joy has an axis at {deflection}")
    size = min(max((abs(deflection) - DEAD_ZONE) / (1 - DEAD_ZONE), 0.0), 1.0)
    return math.copysign(size * (0.4 + 0.6 * size), deflection)
