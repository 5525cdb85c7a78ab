"""Check a commanded pose against the limits of motion, whoever computed it."""

import math

from haptigraph.robot.pose import ToolPose, angle_deg
from haptigraph.robot.rcm import Rcm
from haptigraph.robot.setup import MotionLimits

__all__ = ["DEPTH_SLACK_MM", "SLACK", "CommandCheck"]

SLACK = 1.25
"""Of speed and rotation: a start beside the RCM adds its return to the commanded motion."""
DEPTH_SLACK_MM = 1e-6


class CommandCheck:
    """The last check before a pose is sent.

    Args:
        rcm: The remote centre of motion.
        limits: The limits.
    """

    def __init__(self, rcm: Rcm, limits: MotionLimits) -> None:
        self._rcm, self._limits = rcm, limits

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
        return low_mm - DEPTH_SLACK_MM <= depth_mm <= high_mm + DEPTH_SLACK_MM
