"""Turn a hand's motion into the next commanded pose of a robot, about its RCM and within its limits.

Directions are those of the eye frame. Along: the shaft. Across: perpendicular to the shaft in the section,
z x shaft. Outwards: perpendicular to both, towards the camera.
"""

import math

import numpy as np

from haptigraph.errors import BadInput
from haptigraph.robot.pose import Floats, ToolPose
from haptigraph.robot.rcm import Rcm, turned
from haptigraph.robot.setup import RobotSetup
from haptigraph.teleop.mapping import ToolMotion, rotation_rad

__all__ = ["Follower"]

MIN_RCM_MM = 5.0
"""From the eye's centre to the RCM: nearer, the line between them has no reliable direction."""
POLE = math.sin(math.radians(10.0))
"""Nearer to the camera's axis, across is not defined by the section; it is then +x of the eye frame."""
RETURN = 0.2
"""A shaft that starts beside the RCM comes nearer to it by this share of the tip's motion."""
TINY = 1e-12


class Follower:
    """The commanded motion of one robot. It keeps nothing but the offset at which a motion started.

    Args:
        setup: Where RCM and eye are, and the limits.

    Raises:
        BadInput: If the setup does not say where the eye is, or has the RCM at its centre.
    """

    def __init__(self, setup: RobotSetup) -> None:
        if setup.eye is None:
            raise BadInput(
                "robot.toml has no [eye], so right and left are unknown; add it: haptigraph robot calibrate"
            )
        self.rcm = Rcm(setup.rcm.at_mm, setup.shaft_axis_tool)
        self._limits = setup.limits
        robot_from_eye = setup.eye.robot_from_eye
        self._x, self._z = robot_from_eye.rotation[:, 0], robot_from_eye.rotation[:, 2]
        inwards = robot_from_eye.translation_mm - self.rcm.at_mm
        length_mm = float(np.linalg.norm(inwards))
        if length_mm < MIN_RCM_MM:
            raise BadInput(
                f"robot.toml has its RCM {length_mm:.1f} mm from the eye's centre; it must be in the wall"
            )
        self.inwards = inwards / length_mm
        """From the RCM to the centre of the eye, robot's base, length 1."""
        self._offset_mm = np.zeros(3)

    def start(self, measured: ToolPose) -> None:
        """Begin a motion at a measured pose, whose shaft may be slightly beside the RCM."""
        self._offset_mm = self.rcm.offset_mm(measured)

    def next(self, pose: ToolPose, motion: ToolMotion, elapsed_s: float) -> ToolPose:
        """Return the pose after a motion, within the limits; motion beyond them is lost, not stored.

        A pose outside the limits of depth or tilt may only move towards them.

        Args:
            pose: The commanded pose before.
            motion: Requested displacement of the tip.
            elapsed_s: Duration of the motion.
        """
        limits = self._limits
        depth_mm, along = self.rcm.depth_mm(pose), self.rcm.direction(pose)
        across, outwards = self.directions(along)
        turn = rotation_rad(motion.across_mm, depth_mm) * across
        turn = turn + rotation_rad(motion.outwards_mm, depth_mm) * outwards
        asked_rad = math.hypot(*turn.tolist())
        turn_rad = min(asked_rad, math.radians(limits.turn_deg_s) * elapsed_s)
        tip_mm = math.hypot(motion.along_mm, depth_mm * turn_rad)
        share = min(1.0, limits.speed_mm_s * elapsed_s / max(tip_mm, TINY))
        low_mm, high_mm = min(limits.depth_min_mm, depth_mm), max(limits.depth_max_mm, depth_mm)
        after_mm = min(max(depth_mm + share * motion.along_mm, low_mm), high_mm)
        direction = along
        if asked_rad > 0:
            direction = self._within_tilt(along, turned(along, turn / asked_rad, share * turn_rad))
        exact = self.rcm.pose(after_mm, direction, near=pose)
        moved_mm = math.hypot(after_mm - depth_mm, depth_mm * share * turn_rad)
        return self._beside(exact, moved_mm)

    def directions(self, along: Floats) -> tuple[Floats, Floats]:
        """Return across and outwards for a direction of the shaft, robot's base, (3,) each."""
        x, y, z = self._z.tolist()
        u, v, w = along.tolist()
        across = np.array([y * w - z * v, z * u - x * w, x * v - y * u])
        if math.hypot(*across.tolist()) < POLE:
            across = self._x - (self._x @ along) * along
        across /= math.hypot(*across.tolist())
        a, b, c = across.tolist()
        return across, np.array([v * c - w * b, w * a - u * c, u * b - v * a])

    def tilt_deg(self, along: Floats) -> float:
        """Return the angle between the shaft and the line from the RCM to the centre of the eye."""
        cosine = float(along @ self.inwards)
        return math.degrees(math.atan2(math.hypot(*(along - cosine * self.inwards).tolist()), cosine))

    def _within_tilt(self, before: Floats, after: Floats) -> Floats:
        """Turn a direction back onto the cone of the largest tilt, if it is outside."""
        allowed_deg = max(self._limits.tilt_max_deg, self.tilt_deg(before))
        if self.tilt_deg(after) <= allowed_deg:
            return after
        sideways = after - (after @ self.inwards) * self.inwards
        return turned(self.inwards, sideways / np.linalg.norm(sideways), math.radians(allowed_deg))

    def _beside(self, exact: ToolPose, moved_mm: float) -> ToolPose:
        """Add what is left of the offset at which the motion started."""
        length_mm = math.hypot(*self._offset_mm.tolist())
        left_mm = length_mm - RETURN * moved_mm
        if left_mm <= 0:
            self._offset_mm = np.zeros(3)
            return exact
        along = self.rcm.direction(exact)
        self._offset_mm = self._offset_mm * (left_mm / length_mm)
        self._offset_mm = self._offset_mm - (self._offset_mm @ along) * along
        x, y, z = (np.array(exact.position_mm) + self._offset_mm).tolist()
        return ToolPose((x, y, z), exact.quaternion)
