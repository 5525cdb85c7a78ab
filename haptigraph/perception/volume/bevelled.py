"""A bevelled needle by its parameters.

The needle is a cylinder that a plane cuts: two parameters of shape, six of pose. Everything is in the eye
frame, mm. Many poses are computed at once.
"""

from typing import NamedTuple

import numpy as np

from haptigraph.imaging import Floats

__all__ = ["COUNT", "Frame", "Pose", "pose_of", "rows_of"]

ALONG, ACROSS, UP, LEAN, TURN, ROLL, RADIUS, BEVEL = range(8)
COUNT = 8
"""Parameters: displacement of the tip along the axis, across and upwards [mm]; change of lean and turn [rad];
roll [rad]; radius [mm]; angle between the bevel's face and the axis [rad]."""


class Frame(NamedTuple):
    """The pose from which parameters are counted."""

    tip_mm: Floats
    """A point of the axis, (3,)."""
    lean_rad: float
    """Angle of the axis below the horizontal [rad]."""
    turn_rad: float
    """Direction of the axis in the plane of x and z [rad]; 0: to the right."""

    def basis(self) -> tuple[Floats, Floats, Floats]:
        """Return the directions along the axis, across it in the plane of x and z, and upwards, (3,) each."""
        along, across, up = _basis(np.array(self.lean_rad), np.array(self.turn_rad))
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
    along, _, up = _basis(frame.lean_rad + parameters[:, LEAN], frame.turn_rad + parameters[:, TURN])
    axis_mm = (
        frame.tip_mm
        + parameters[:, ALONG, None] * ahead
        + parameters[:, ACROSS, None] * beside
        + parameters[:, UP, None] * upwards
    )
    roll = parameters[:, ROLL, None]
    facing = np.cos(roll) * up + np.sin(roll) * np.cross(along, up)
    return Pose(axis_mm - parameters[:, RADIUS, None] * facing, along, facing, axis_mm)


def rows_of(pose: Pose, parameters: Floats) -> Floats:
    """Return poses as `native.needle_scores` takes them, (p, 13)."""
    bevel = parameters[:, BEVEL, None]
    face = np.sin(bevel) * pose.along + np.cos(bevel) * pose.facing
    return np.concatenate([pose.along, pose.axis_mm, face, pose.tip_mm, parameters[:, RADIUS, None]], axis=1)
