"""Rig -> where everything is, in the eye frame [mm]: mirror, camera, base, legs. Pure geometry, without CAD.

Eye frame: x right, y up, z towards the camera; the section is z = 0. The base plate lies below; its upper
face is y = `base_mm`.
"""

import math
from pathlib import Path

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.errors import BadInput
from haptigraph.rig.description import Mirror, Rig
from rig.standard import SHANK_MM, SLIDE_MM

__all__ = ["BOARD_GAP_MM", "FLOOR_MM", "LEG_MM", "MOUNT_MM", "CameraPose", "Layout", "Screw", "layout_of"]

Vector = NDArray[np.float64]
RIGHT, UP, FORWARD = np.eye(3)
FLOOR_MM = 8.0
"""Thickness of what stands on the base and takes an insert from below."""
BOARD_GAP_MM = 5.0
"""Between the back of a bare camera board and its mount."""
BEHIND_MM = 4.0
"""Of the eye's boss behind the bowl."""
MOUNT_MM = 9.0
"""How far the camera's mount extends beyond its housing."""
LEG_MM = 12.0
"""Width of the light's legs."""


class Screw(Struct, frozen=True):
    """An M3 cylinder-head screw: where its head rests, the direction from there to its end, its length."""

    at_mm: tuple[float, float, float]
    towards: tuple[float, float, float]
    length_mm: float
    size_mm: float = SHANK_MM


class CameraPose(Struct, frozen=True):
    """Pose of the camera's housing; `right` and `up` as seen from behind it."""

    front_mm: Vector
    """Centre of the front face."""
    look: Vector
    up: Vector
    right: Vector
    pupil_mm: Vector
    """The entrance pupil, on the optical axis."""

    def at(self, right_mm: float, up_mm: float, behind_mm: float) -> Vector:
        """Return a point given from the centre of the front face."""
        return self.front_mm + right_mm * self.right + up_mm * self.up - behind_mm * self.look


class Layout(Struct, frozen=True):
    """Where everything is."""

    rig: Rig
    camera: CameraPose
    radius_mm: float
    """Of the globe."""
    outer_mm: float
    """Outer radius above the retina shell."""
    bulge_mm: float
    """Outer radius around the retina shell."""
    retina_edge_mm: float
    """y of the shell's edge."""
    back_mm: float
    """z of the back of the eye's boss."""
    base_mm: float
    """y of the upper face of the base."""
    wall_mm: float
    """Distance of the mirror mount's walls from the middle plane, inside."""
    leg_mm: float
    """Distance of the light's legs from the middle plane, their middle."""
    mirror: Mirror | None

    @property
    def mirror_center_mm(self) -> Vector:
        """Centre of the reflecting surface; without a mirror, of the section."""
        return self.mirror.from_section_mm * FORWARD if self.mirror else 0 * FORWARD

    @property
    def depth_mm(self) -> float:
        """Of the camera and what is between it and its mount."""
        return self.rig.camera.body_mm[2] + (BOARD_GAP_MM if self.is_board else SLIDE_MM)

    @property
    def is_board(self) -> bool:
        """Whether the camera is a bare board on screws, not a housing in a cradle."""
        return bool(self.rig.camera.screws_mm)

    def on_globe(self, from_top_deg: float, radius_mm: float | None = None) -> Vector:
        """Return a point of the section at an angle from the top, positive to the right."""
        angle = math.radians(from_top_deg)
        return (radius_mm or self.radius_mm) * np.array([math.sin(angle), math.cos(angle), 0.0])


def layout_of(rig: Rig, file: str | Path) -> Layout:
    """Place everything.

    Args:
        rig: The rig.
        file: Its file, for errors.

    Raises:
        BadInput: If the mounts cannot be built for it.
    """
    mirror = rig.mirrors[0] if rig.mirrors else None
    if mirror is not None and (mirror.turns, mirror.angle_deg) != ("down", 45.0):
        raise BadInput(
            f"the mirror turns the path {mirror.turns} at {mirror.angle_deg:g}°; the mounts are drawn for "
            'turns = "down" and angle_deg = 45, with the camera below',
            file,
        )
    pose = _camera_pose(rig, mirror)
    eye = rig.eye
    if abs(eye.target_deg) + math.degrees(eye.target_mm / eye.diameter_mm) >= eye.retina_half_deg:
        raise BadInput(
            f"the target at {eye.target_deg:g}° is not within the retina, which extends "
            f"{eye.retina_half_deg:g}° either way",
            file,
        )
    radius = eye.diameter_mm / 2
    bulge = radius + eye.retina_mm + SLIDE_MM + eye.wall_mm
    half_width, half_height, _ = (side / 2 for side in rig.camera.body_mm)
    if mirror is not None:
        gap = BOARD_GAP_MM if rig.camera.screws_mm else SLIDE_MM
        base = pose.front_mm[1] - rig.camera.body_mm[2] - gap - FLOOR_MM
        aside = abs(pose.front_mm[0]) + half_width + MOUNT_MM
        wall = max(aside, mirror.size_mm[0] / 2 + 2.0) + 1.5
    else:
        base = -max(half_height + MOUNT_MM, bulge, rig.light.diameter_mm / 2 + 5.0) - 16.0
        aside, wall = half_width + MOUNT_MM, 0.0
    leg = max(aside + 1.0, rig.light.diameter_mm / 2 + 8.0) + LEG_MM / 2
    return Layout(
        rig=rig,
        camera=pose,
        radius_mm=radius,
        outer_mm=radius + eye.wall_mm,
        bulge_mm=bulge,
        retina_edge_mm=-radius * math.cos(math.radians(eye.retina_half_deg)),
        back_mm=-(bulge + BEHIND_MM),
        base_mm=float(base),
        wall_mm=wall,
        leg_mm=leg,
        mirror=mirror,
    )


def _camera_pose(rig: Rig, mirror: Mirror | None) -> CameraPose:
    """The unfolded camera looks along -z with its top up; a mirror reflects position, look and top."""
    camera = rig.camera
    look, up = -FORWARD, UP
    pupil = rig.path_mm * FORWARD
    if mirror is not None:
        normal = np.array([0.0, 1.0, 1.0]) / math.sqrt(2)
        look, up = (_reflected(way, normal) for way in (look, up))
        center = mirror.from_section_mm * FORWARD
        pupil = center + _reflected(pupil - center, normal)
    right = np.cross(look, up)
    off_right_mm, off_up_mm = camera.pupil_off_mm
    front = pupil + camera.pupil_mm * look - off_right_mm * right - off_up_mm * up
    return CameraPose(front, look, up, right, pupil)


def _reflected(way: Vector, normal: Vector) -> Vector:
    return np.asarray(way - 2 * (way @ normal) * normal)
