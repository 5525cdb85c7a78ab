"""Turn sensor_msgs/Joy into motion of the hand that steers the phantom, as the live page's sticks do.

Left stick: back is into the eye (down in the picture), right is to the surgeon's right. The right shoulder
button is the clutch: without it nothing moves.
"""

import math
from collections.abc import Callable

from haptigraph.clock import Clock
from haptigraph.ros2.types import Joy
from haptigraph.teleop.motion import HandMotion

__all__ = ["JoySteering"]

ACROSS, ALONG = 0, 1
"""Axes; in ROS left and forward are positive (https://index.ros.org/p/joy)."""
CLUTCH = 5
"""Button: the right shoulder where a joy_node shows a pad in its usual order."""
DEAD = 0.12
SPEED_MM_S = 30.0
LONGEST_NS = 100_000_000
"""A message stands for no longer than this, so that a node that hangs does not move the needle far."""


class JoySteering:
    """Pass on what a joystick wants.

    Args:
        put: Where motion of the hand goes.
        clock: Tells how long a stick was held.
    """

    def __init__(self, put: Callable[[HandMotion], None], clock: Clock) -> None:
        self._put, self._clock = put, clock
        self._then_ns = clock.now_ns()

    def take(self, message: Joy) -> None:
        """Take one message.

        Raises:
            ValueError: If it has no such axes or button, or a number that is none; the clutch is released.
        """
        now_ns = self._clock.now_ns()
        elapsed_s = min(now_ns - self._then_ns, LONGEST_NS) / 1e9
        self._then_ns = now_ns
        try:
            motion = _motion(message, SPEED_MM_S * elapsed_s)
        except ValueError:
            self._put(HandMotion(engaged=False))
            raise
        self._put(motion)


def _motion(message: Joy, way_mm: float) -> HandMotion:
    axes, buttons = message.axes, message.buttons
    if len(axes) <= max(ACROSS, ALONG) or len(buttons) <= CLUTCH:
        raise ValueError(
            f"joy has {len(axes)} axes and {len(buttons)} buttons; axes {ACROSS} and {ALONG} and button "
            f"{CLUTCH} are used"
        )
    if not buttons[CLUTCH]:
        return HandMotion(engaged=False)
    return HandMotion(True, -_shaped(axes[ALONG]) * way_mm, -_shaped(axes[ACROSS]) * way_mm)


def _shaped(axis: float) -> float:
    """Shape a stick: still about its middle, fine near it, full at its end."""
    if not math.isfinite(axis):
        raise ValueError(f"joy has an axis at {axis}")
    size = min(max((abs(axis) - DEAD) / (1 - DEAD), 0.0), 1.0)
    return math.copysign(size * (0.4 + 0.6 * size), axis)
