"""The simulated needle of a volume: a thin cylinder with a bevel, its reflection and its shadow.

Turns a pose (eye frame, mm) into the height of the metal's upper side at any A-scan, and into the light that
it scatters and blocks. OCT shows only the side that faces the beam. Metal blocks all light, so there is only
noise below it. At an edge the beam, which has a width, is blocked in part.
"""

import math
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from haptigraph.imaging import Floats
from haptigraph.sim.oct.appearance import Level, intensity

__all__ = ["NeedlePose", "SliceNeedle", "VolumeNeedle", "needle_in_slice", "pose", "upper_mm"]

BLOB_MM = 0.04  # radius of the bright spot at the tip
SIDE_DB = 14.0  # loss of brightness from the ridge to the cylinder's sides
SOFT_MM = 0.013  # axial width of the transition at the ILM
BEAM = (-1.4, -0.7, 0.0, 0.7, 1.4)  # sampled positions across the beam, in standard deviations
BEAM_SHARES = tuple(math.exp(-(at**2) / 2) for at in BEAM)


class VolumeNeedle(Struct, frozen=True, forbid_unknown_fields=True):
    """The [needle] table of a volume scenario."""

    diameter_mm: Annotated[float, Meta(ge=0.03, le=1)] = 0.11
    """41 gauge."""
    bevel_deg: Annotated[float, Meta(ge=8, le=80)] = 26.0
    """Angle between the bevel's face and the axis."""
    roll_deg: Annotated[float, Meta(ge=-360, le=360)] = 0.0
    """Rotation about the axis; 0: the bevel faces up, 180: down."""
    bright_db: Annotated[float, Meta(ge=0, le=50)] = 30.0
    """Brightness of the ridge, above the noise."""
    ridge_mm: Annotated[float, Meta(ge=0.003, le=0.2)] = 0.018
    """Axial width of the ridge at half its brightness (in decibels above the noise)."""
    tissue_loss_db: Annotated[float, Meta(ge=0, le=50)] = 17.0
    """Loss of brightness inside tissue."""
    gap_db: Annotated[float, Meta(ge=0, le=50)] = 8.0
    """Loss of brightness on the bevel's face, except at the tip."""
    beam_mm: Annotated[float, Meta(ge=0.001, le=0.1)] = 0.008
    """Standard deviation of the beam's width, which softens the shadow's edge."""


class NeedlePose(NamedTuple):
    """Pose of a needle, eye frame, (3,) each."""

    tip_mm: Floats
    """The sharp end of the bevel."""
    along: Floats
    """Direction of the axis towards the tip, length 1."""
    facing: Floats
    """Direction to which the bevel opens, length 1, perpendicular to the axis."""

    def axis_mm(self, diameter_mm: float) -> Floats:
        """Return the point of the axis beside the tip."""
        return np.asarray(self.tip_mm + diameter_mm / 2 * self.facing, np.float64)

    def moved(self, by_mm: Floats) -> "NeedlePose":
        """Return the pose displaced by some vector."""
        return self._replace(tip_mm=self.tip_mm + by_mm)


def pose(tip_mm: Floats, lean_deg: float, turn_deg: float, roll_deg: float) -> NeedlePose:
    """Return a pose by its angles.

    Args:
        tip_mm: The tip, (x, y, z), eye frame.
        lean_deg: Angle of the axis below the horizontal, 0 to 90.
        turn_deg: Direction of the axis in the plane of x and z: 0 to the right, 90 to the viewer.
        roll_deg: Rotation about the axis; 0: the bevel faces up.
    """
    lean, turn, roll = (math.radians(angle) for angle in (lean_deg, turn_deg, roll_deg))
    flat = np.array([math.cos(turn), 0.0, math.sin(turn)])
    along = math.cos(lean) * flat - math.sin(lean) * np.array([0.0, 1.0, 0.0])
    upper = math.sin(lean) * flat + math.cos(lean) * np.array([0.0, 1.0, 0.0])
    facing = math.cos(roll) * upper + math.sin(roll) * np.cross(along, upper)
    return NeedlePose(np.asarray(tip_mm, np.float64), along, facing)


def upper_mm(needle: NeedlePose, shape: VolumeNeedle, x_mm: Floats, z_mm: Floats) -> tuple[Floats, Floats]:
    """Return the height of the metal's upper side, minus infinity beside it, and its reflection [dB].

    Args:
        needle: The pose.
        shape: Diameter and bevel.
        x_mm: Positions; x and z broadcast.
        z_mm: Positions.
    """
    radius_mm, bevel = shape.diameter_mm / 2, math.radians(shape.bevel_deg)
    (dx, dy, dz), centre = needle.along, needle.axis_mm(shape.diameter_mm)
    off_x, off_z = x_mm - centre[0], z_mm - centre[2]
    level = off_x * dx + off_z * dz
    cos2 = 1 - dy * dy
    root = radius_mm**2 * cos2 - (off_x**2 + off_z**2) * cos2 + level**2
    half_mm = np.sqrt(np.maximum(root, 0)) / cos2  # of the vertical chord through the cylinder
    middle_mm = level * dy / cos2
    face = math.sin(bevel) * needle.along + math.cos(bevel) * needle.facing  # outwards
    tip_x, tip_y, tip_z = needle.tip_mm
    beyond = (x_mm - tip_x) * face[0] + (z_mm - tip_z) * face[2]
    at_upper = beyond + (centre[1] + middle_mm + half_mm - tip_y) * face[1]
    face_mm = tip_y - beyond / (face[1] if abs(face[1]) > 1e-9 else 1e-9)
    on_face = at_upper > 0
    upper = np.where(on_face, face_mm, centre[1] + middle_mm + half_mm)
    is_metal = (root > 0) & (~on_face | ((face[1] > 0) & (face_mm > centre[1] + middle_mm - half_mm)))
    steep = np.sqrt(np.maximum(root, 0) / (radius_mm**2 * cos2))
    near_tip = np.hypot(np.hypot(x_mm - tip_x, z_mm - tip_z), upper - tip_y) < BLOB_MM
    db = shape.bright_db - np.where(on_face, np.where(near_tip, 0.0, shape.gap_db), SIDE_DB * (1 - steep))
    return np.where(is_metal, upper, -np.inf), db


class SliceNeedle(NamedTuple):
    """What a needle does to the light in one slice, by columns that it covers, (k,)."""

    columns: NDArray[np.intp]
    light: Level
    """Share of light that reaches each pixel, (h, k)."""
    metal: Level
    """Mean intensity that the metal scatters, noise = 1, (h, k)."""


def needle_in_slice(
    needle: NeedlePose, shape: VolumeNeedle, x_mm: Floats, z_mm: float, y_mm: Floats, ilm_mm: Floats
) -> SliceNeedle | None:
    """Return a needle's effect in one slice; None if it does not cross it.

    Args:
        needle: The pose.
        shape: Its dimensions and reflection.
        x_mm: Positions of the columns, (w,).
        z_mm: Position of the slice.
        y_mm: Heights of the rows, (h,).
        ilm_mm: Height of the ILM, (w,).
    """
    offsets = np.array(BEAM) * shape.beam_mm
    shares = np.outer(BEAM_SHARES, BEAM_SHARES).ravel() / sum(BEAM_SHARES) ** 2
    dz, dx = (part.ravel()[:, None] for part in np.meshgrid(offsets, offsets, indexing="ij"))
    tops, db = upper_mm(needle, shape, x_mm + dx, z_mm + dz)
    columns = np.flatnonzero(np.isfinite(tops).any(axis=0))
    if not len(columns):
        return None
    rows = y_mm[:, None].astype(np.float32)
    light = np.ones((len(y_mm), len(columns)), np.float32)
    metal = np.zeros_like(light)
    sharp = np.float32(2 * shape.bright_db / shape.ridge_mm**2)
    loss = shape.tissue_loss_db * np.clip((ilm_mm[columns] - rows) / SOFT_MM + 0.5, 0, 1)
    for share, top, bright in zip(shares, tops[:, columns], db[:, columns], strict=True):
        hit = np.isfinite(top)
        above = np.float32(share) * ((rows < top) & hit)
        light -= above
        off = rows - np.where(hit, top, 0).astype(np.float32)
        level = intensity(bright.astype(np.float32) - sharp * off**2 - loss)
        metal += np.float32(share) * np.where(hit, level, 0)
    return SliceNeedle(columns, np.maximum(light, 0), metal)
