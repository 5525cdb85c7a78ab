"""A bevelled needle as a shape: where the metal's upper side is at any A-scan.

The needle is a cylinder that a plane cuts: two parameters of shape, six of pose. Everything is in the eye
frame, mm. Many poses are evaluated at once.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptigraph.imaging import Floats

__all__ = ["COUNT", "Frame", "Pose", "pose_of", "upper_mm"]

ALONG, ACROSS, UP, LEAN, TURN, ROLL, RADIUS, BEVEL = range(8)
COUNT = 8
"""Parameters: displacement of the tip along the axis, across and upwards [mm]; change of lean and turn [rad];
roll [rad]; radius [mm]; angle between the bevel's face and the axis [rad]."""


class Frame(NamedTuple):
    """The pose from which parameters are counted."""

    tip_mm: Floats
    """A point of the axis, (3,)."""
    lean: float
    """Angle of the axis below the horizontal [rad]."""
    turn: float
    """Direction of the axis in the plane of x and z [rad]; 0: to the right."""

    def basis(self) -> tuple[Floats, Floats, Floats]:
        """Return the directions along the axis, across it in the plane of x and z, and upwards, (3,) each."""
        along, across, up = _basis(np.array(self.lean), np.array(self.turn))
        return along, across, up


class Pose(NamedTuple):
    """Poses, one a row."""

    tip_mm: Floats
    """The sharp end, (p, 3)."""
    along: Floats
    """Direction of the axis towards the tip, (p, 3)."""
    facing: Floats
    """Direction to which the bevel opens, (p, 3)."""
    axis_mm: Floats
    """The point of the axis beside the sharp end, (p, 3)."""


def _basis(lean: Floats, turn: Floats) -> tuple[Floats, Floats, Floats]:
    cos_lean, sin_lean, cos_turn, sin_turn = np.cos(lean), np.sin(lean), np.cos(turn), np.sin(turn)
    nothing = np.zeros_like(lean)
    along = np.stack([cos_lean * cos_turn, -sin_lean, cos_lean * sin_turn], axis=-1)
    across = np.stack([-sin_turn, nothing, cos_turn], axis=-1)
    up = np.stack([sin_lean * cos_turn, cos_lean, sin_lean * sin_turn], axis=-1)
    return along, across, up


def pose_of(frame: Frame, parameters: Floats) -> Pose:
    """Return poses by their parameters, (p, COUNT)."""
    ahead, beside, upwards = frame.basis()
    along, _, up = _basis(frame.lean + parameters[:, LEAN], frame.turn + parameters[:, TURN])
    axis_mm = (
        frame.tip_mm
        + parameters[:, ALONG, None] * ahead
        + parameters[:, ACROSS, None] * beside
        + parameters[:, UP, None] * upwards
    )
    roll = parameters[:, ROLL, None]
    facing = np.cos(roll) * up + np.sin(roll) * np.cross(along, up)
    return Pose(axis_mm - parameters[:, RADIUS, None] * facing, along, facing, axis_mm)


def upper_mm(pose: Pose, parameters: Floats, x_mm: Floats, z_mm: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the height of the metal's upper side and whether there is metal, (p, m) each.

    Args:
        pose: The poses.
        parameters: Their parameters, (p, COUNT).
        x_mm: Positions of the A-scans, (m,).
        z_mm: Positions of the A-scans, (m,).
    """
    radius_mm = parameters[:, RADIUS, None]
    (dx, dy, dz), (cx, cy, cz) = (part.T[..., None] for part in (pose.along, pose.axis_mm))
    off_x, off_z = x_mm - cx, z_mm - cz
    level = off_x * dx + off_z * dz
    cos2 = 1 - dy * dy
    root = (radius_mm**2 - off_x**2 - off_z**2) * cos2 + level**2
    half_mm = np.sqrt(np.maximum(root, 0)) / cos2
    middle_mm = cy + level * (dy / cos2)
    cylinder_mm = middle_mm + half_mm
    bevel = parameters[:, BEVEL, None]
    face = np.sin(bevel) * pose.along + np.cos(bevel) * pose.facing
    (fx, fy, fz), (tx, ty, tz) = (part.T[..., None] for part in (face, pose.tip_mm))
    beyond = (x_mm - tx) * fx + (z_mm - tz) * fz
    on_face = beyond + (cylinder_mm - ty) * fy > 0
    face_mm = ty - beyond / np.where(np.abs(fy) > 1e-9, fy, 1e-9)
    is_metal = (root > 0) & (~on_face | ((fy > 0) & (face_mm > middle_mm - half_mm)))
    return np.where(on_face, face_mm, cylinder_mm), is_metal
