"""Check a commanded pose against the limits of motion, whoever computed it."""

import math

from haptigraph.robot.pose import Floats, ToolPose, angle_deg
from haptigraph.robot.rcm import Rcm
from haptigraph.robot.setup import MotionLimits

__all__ = ["CommandCheck"]

SLACK = 1.25
"""Of speed and rotation: a start beside the RCM adds its return to the commanded motion."""
ROUNDING = 1e-6


class CommandCheck:
    """The last check before a pose is sent.

    Args:
        rcm: The remote centre of motion.
        limits: The limits.
        inwards: From the RCM to the centre of the eye, length 1, (3,).
    """

    def __init__(self, rcm: Rcm, limits: MotionLimits, inwards: Floats) -> None:
        self._rcm, self._limits = rcm, limits
        self._inwards: list[float] = inwards.tolist()

    def allows(self, before: ToolPose, after: ToolPose, elapsed_s: float) -> bool:
        """Return whether a pose may be commanded.

        Args:
            before: The commanded pose before.
            after: The next one.
            elapsed_s: Between them.
        """
        if not after.is_finite or self._rcm.distance_mm(after) > self._limits.rcm_tolerance_mm:
            return False
        limits = self._limits
        step_mm = math.dist(after.position_mm, before.position_mm)
        if step_mm > SLACK * limits.speed_mm_s * elapsed_s:
            return False
        if angle_deg(before, after) > SLACK * limits.turn_deg_s * elapsed_s:
            return False
        depth_mm, was_mm = self._rcm.depth_mm(after), self._rcm.depth_mm(before)
        low_mm, high_mm = min(limits.depth_min_mm, was_mm), max(limits.depth_max_mm, was_mm)
        if not low_mm - ROUNDING <= depth_mm <= high_mm + ROUNDING:
            return False
        return self._tilt_deg(after) <= max(limits.tilt_max_deg, self._tilt_deg(before)) + ROUNDING

    def _tilt_deg(self, pose: ToolPose) -> float:
        """Return the angle to the centre of the eye, from the length of the chord between the directions."""
        chord = math.dist(self._rcm.direction(pose).tolist(), self._inwards)
        return math.degrees(2 * math.asin(min(chord / 2, 1.0)))
