"""The simulated robot: moves the needle about the trocar's remote centre of motion, in the section.

It has two degrees of freedom, depth and pitch, plus the opening of jaws, with limits on range and speed.
"""

import math
from typing import Annotated

from msgspec import Meta, Struct

from haptigraph.geometry import Vec, rotate, unit

__all__ = ["JAWS_MAX_MM", "JAWS_SPEED_MM_S", "Pose", "Robot", "RobotLimits"]

JAWS_MAX_MM = 4.0
"""Between the tips of fully open jaws."""
JAWS_SPEED_MM_S = 4.0


class RobotLimits(Struct, frozen=True, forbid_unknown_fields=True):
    """The [robot] table of a scenario."""

    motion_scale: Annotated[float, Meta(ge=0, le=10)] = 0.2
    """Tool motion over hand motion."""
    pitch_limit_deg: Annotated[float, Meta(ge=0, le=90)] = 50.0
    """To either side of the line RCM -> globe centre."""
    depth_min_mm: Annotated[float, Meta(ge=-100, le=100)] = -12.0
    depth_max_mm: Annotated[float, Meta(ge=-100, le=100)] = 26.0
    speed_limit_mm_s: Annotated[float, Meta(gt=0, le=10_000)] = 20.0
    turn_limit_deg_s: Annotated[float, Meta(gt=0, le=10_000)] = 30.0


class Pose(Struct, frozen=True):
    """Pose of the instrument."""

    depth_mm: float
    """From the RCM to the tip; negative while the tip is outside."""
    pitch_deg: float
    """From the line RCM -> globe centre to the shaft, counter-clockwise."""
    jaws_mm: float = 0.0
    """Distance between the tips of the jaws, for forceps."""


class Robot:
    """A needle holder that rotates about the trocar.

    Args:
        rcm_mm: The remote centre of motion, eye frame.
        limits: Limits of its motion.
        start: Initial pose.
    """

    def __init__(self, rcm_mm: Vec, limits: RobotLimits, start: Pose) -> None:
        self._rcm_mm, self._limits = rcm_mm, limits
        self._inwards = unit((-rcm_mm[0], -rcm_mm[1]))
        self.pose = self._within(start)

    def follow(self, target: Pose, step_s: float) -> Pose:
        """Move towards a pose for some time, as fast as the limits allow, and return the new pose."""
        target = self._within(target)
        self.pose = Pose(
            _towards(self.pose.depth_mm, target.depth_mm, self._limits.speed_limit_mm_s * step_s),
            _towards(self.pose.pitch_deg, target.pitch_deg, self._limits.turn_limit_deg_s * step_s),
            _towards(self.pose.jaws_mm, target.jaws_mm, JAWS_SPEED_MM_S * step_s),
        )
        return self.pose

    def direction(self) -> Vec:
        """Return the direction of the shaft, into the eye, length 1."""
        return rotate(self._inwards, self.pose.pitch_deg)

    def tip_mm(self) -> Vec:
        """Return the tip, eye frame."""
        along = self.direction()
        return (
            self._rcm_mm[0] + self.pose.depth_mm * along[0],
            self._rcm_mm[1] + self.pose.depth_mm * along[1],
        )

    def pitch_towards(self, point_mm: Vec) -> float:
        """Return the pitch [deg] at which the shaft points at a point."""
        x, y = point_mm[0] - self._rcm_mm[0], point_mm[1] - self._rcm_mm[1]
        u, v = self._inwards
        return math.degrees(math.atan2(u * y - v * x, u * x + v * y))

    def _within(self, pose: Pose) -> Pose:
        limit = self._limits
        return Pose(
            min(max(pose.depth_mm, limit.depth_min_mm), limit.depth_max_mm),
            min(max(pose.pitch_deg, -limit.pitch_limit_deg), limit.pitch_limit_deg),
            min(max(pose.jaws_mm, 0.0), JAWS_MAX_MM),
        )


def _towards(value: float, target: float, max_change: float) -> float:
    return value + min(max(target - value, -max_change), max_change)
