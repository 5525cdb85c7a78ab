"""Geometry of a scene: eye, trocars, target and needle in the eye frame, and their projection into the image.

The eye frame is the section in which the needle moves; the camera faces it at 200 mm. `behind_mm` is the
distance of a point behind that section, away from the camera.
"""

import math
from functools import cached_property
from typing import TypeAlias

from msgspec import Struct

from haptigraph.geometry import Vec, norm, rotate, subtract, unit
from haptigraph.projection import ImageGeometry
from haptigraph.sim.eye.eye import Eye, EyeShape
from rendering.path import Pose, needle_path
from rendering.scene import Scene

__all__ = [
    "CUT_MM",
    "DISTANCE_MM",
    "HEIGHT_PX",
    "TROCARS_DEG",
    "WALL_MM",
    "WIDTH_PX",
    "Box",
    "Layout",
    "Placed",
]

WIDTH_PX, HEIGHT_PX = 1280, 720
DISTANCE_MM = 200.0
"""From the camera to the section."""
WALL_MM = 1.8
CUT_MM = 0.6
"""Height of the cut wall in front of the section."""
TROCARS_DEG = {"first": 36.0, "second": -37.0}
"""From the top."""
Box: TypeAlias = tuple[int, int, int, int]
"""Left, top, right and bottom of a part of an image [px]; right and bottom are exclusive."""

MARGIN_MM = 4.0  # around the eye, for the needle and its shadow


class Placed(Struct, frozen=True):
    """A needle in a pose."""

    axis_mm: Vec
    """End of its axis, eye frame."""
    direction: Vec
    """Of the shaft, towards the tip."""
    tip_mm: Vec
    """The tip; that of a bevel is beside the axis."""
    behind_mm: float
    """Distance of the tip behind the section."""


class Layout:
    """The geometry of one scene.

    Args:
        scene: The scene.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.eyes = {
            name: Eye(EyeShape(wall_mm=WALL_MM, target_deg=scene.target_deg, trocar_deg=trocar_deg))
            for name, trocar_deg in TROCARS_DEG.items()
        }
        """The same eye, entered through either trocar."""
        self.eye = self.eyes[scene.trocar]
        self.axis_mm = subtract(self.eye.target_mm, self.eye.trocar_mm)
        """From the trocar to the target."""

    @cached_property
    def poses(self) -> tuple[Pose, ...]:
        """Pose of the needle in every image."""
        return needle_path(norm(self.axis_mm), self.scene.start_deg)

    @cached_property
    def image(self) -> ImageGeometry:
        """Geometry of the section in the image."""
        middle_px, camera = _middle_px(), self.scene.camera
        right_mm, up_mm = camera.globe_mm
        center_px = middle_px[0] + right_mm * camera.px_per_mm, middle_px[1] - up_mm * camera.px_per_mm
        return ImageGeometry(center_px, 1 / camera.px_per_mm, mirrored=False)

    def to_px(self, point_mm: Vec, behind_mm: float = 0.0) -> Vec:
        """Project a point into the image (perspective)."""
        scale = DISTANCE_MM / (DISTANCE_MM + behind_mm)
        middle_px, point_px = _middle_px(), self.image.to_px(point_mm)
        return (
            middle_px[0] + scale * (point_px[0] - middle_px[0]),
            middle_px[1] + scale * (point_px[1] - middle_px[1]),
        )

    def placed(self, pose: Pose) -> Placed:
        """Return the needle's tip and axis in a pose."""
        direction = rotate(unit(self.axis_mm), pose.theta_deg)
        axis_mm = _along(self.eye.trocar_mm, direction, pose.depth_mm)
        needle = self.scene.needle
        if needle.roll_deg is None:
            return Placed(axis_mm, direction, axis_mm, 0.0)
        roll, radius_mm = math.radians(needle.roll_deg), needle.width_mm / 2
        tip_mm = _along(axis_mm, rotate(direction, 90.0), radius_mm * math.cos(roll))
        return Placed(axis_mm, direction, tip_mm, radius_mm * math.sin(roll))

    def is_visible(self, placed: Placed) -> bool:
        """Return whether the cut wall does not occlude the tip; ignores beads and other instruments."""
        inner_mm, outer_mm = (_rim_mm(self.eye.radius_mm + wall_mm) for wall_mm in (0.0, WALL_MM))
        return not inner_mm <= self._from_center_mm(placed) <= outer_mm

    def is_inside(self, placed: Placed) -> bool:
        """Return whether the tip is inside the globe, or was pushed from there into the retina."""
        to_target_mm = subtract(self.eye.target_mm, placed.axis_mm)
        is_near_target = norm(to_target_mm) < norm(self.axis_mm) / 2
        return is_near_target or self._from_center_mm(placed) < self.eye.radius_mm

    def second_instrument(self) -> tuple[Vec, Vec] | None:
        """Return end [mm] and direction of the second instrument."""
        instrument = self.scene.second_instrument
        if instrument is None:
            return None
        (other,) = (eye for name, eye in self.eyes.items() if name != self.scene.trocar)
        direction = unit(subtract(other.on_retina(instrument.aim_deg), other.trocar_mm))
        return _along(other.trocar_mm, direction, instrument.depth_mm), direction

    def changing_px(self) -> Box:
        """Return the part of the image that the needle may change."""
        (x, y), px_per_mm = self.image.center_px, self.scene.camera.px_per_mm
        outer_mm = self.eye.radius_mm + WALL_MM
        half_px = px_per_mm * (outer_mm + MARGIN_MM)
        bottom_px = y + px_per_mm * outer_mm + 5
        left, right = max(0, math.floor(x - half_px)), min(WIDTH_PX, math.ceil(x + half_px))
        return left, 0, right, min(HEIGHT_PX, math.ceil(bottom_px))

    def _from_center_mm(self, placed: Placed) -> float:
        return math.hypot(*placed.tip_mm, placed.behind_mm)


def _middle_px() -> Vec:
    return (WIDTH_PX - 1) / 2, (HEIGHT_PX - 1) / 2


def _along(start_mm: Vec, direction: Vec, length_mm: float) -> Vec:
    return start_mm[0] + length_mm * direction[0], start_mm[1] + length_mm * direction[1]


def _rim_mm(radius_mm: float) -> float:
    """Return the radius of a sphere's cut edge, projected onto the section behind it."""
    return math.sqrt(radius_mm**2 - CUT_MM**2) * DISTANCE_MM / (DISTANCE_MM - CUT_MM)
