"""Convert sensor_msgs/Joy to hand motion that steers the phantom, like the sticks on the live page.

Left stick: back moves into the eye (down in the image), right to the surgeon's right. The right shoulder
button is the clutch, without which nothing moves.
"""

import math
from collections.abc import Callable

from haptigraph.clock import Clock
from haptigraph.ros2.types import Joy
from haptigraph.teleop.motion import HandMotion

__all__ = ["JoySteering"]

ACROSS, ALONG = 0, 1
"""Axes; ROS defines left and forward as positive (https://index.ros.org/p/joy)."""
CLUTCH = 5
"""Button: the right shoulder in the usual order of joy_node."""
DEAD_ZONE = 0.12
SPEED_MM_S = 30.0
MAX_DURATION_NS = 100_000_000
"""A message is applied for at most this time, so that a hanging node does not move the needle far."""


class JoySteering:
    """Integrate stick deflections to hand motion.

    Args:
        put: Receives the motion.
        clock: Measures how long a stick was held.
    """

    def __init__(self, put: Callable[[HandMotion], None], clock: Clock) -> None:
        self._put, self._clock = put, clock
        self._last_ns = clock.now_ns()

    def take(self, message: Joy) -> None:
        """Process one message.

        Raises:
            ValueError: If it lacks an axis or button, or has a non-finite axis; the clutch is then released.
        """
        now_ns = self._clock.now_ns()
        elapsed_s = min(now_ns - self._last_ns, MAX_DURATION_NS) / 1e9
        self._last_ns = now_ns
        try:
            motion = _motion(message, SPEED_MM_S * elapsed_s)
        except ValueError:
            self._put(HandMotion(engaged=False))
            raise
        self._put(motion)


def _motion(message: Joy, distance_mm: float) -> HandMotion:
    axes, buttons = message.axes, message.buttons
    if len(axes) <= max(ACROSS, ALONG) or len(buttons) <= CLUTCH:
        raise ValueError(
            f"joy has {len(axes)} axes and {len(buttons)} buttons; axes {ACROSS} and {ALONG} and button "
            f"{CLUTCH} are used"
        )
    if not buttons[CLUTCH]:
        return HandMotion(engaged=False)
    return HandMotion(True, -_shaped(axes[ALONG]) * distance_mm, -_shaped(axes[ACROSS]) * distance_mm)


def _shaped(axis: float) -> float:
    """Apply a dead zone and a response curve: fine near the centre, full at the end."""
    if not math.isfinite(axis):
        raise ValueError(f"joy has an axis at {axis}")
    size = min(max((abs(axis) - DEAD_ZONE) / (1 - DEAD_ZONE), 0.0), 1.0)
    return math.copysign(size * (0.4 + 0.6 * size), axis)
