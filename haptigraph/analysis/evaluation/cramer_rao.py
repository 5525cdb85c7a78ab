"""The Cramer-Rao bound: how exactly an image can tell the shaft's angle at all, given the sensor's noise.

No unbiased estimate from one image has a smaller deviation (Kay 1993, Fundamentals of Statistical Signal
Processing I, section 3.5: Gaussian noise, unknown mean). The simulator's noise is the same in all three
colours, so a pixel counts once, as grey. Rounding to 8 bits is left out. The shadow would tell of the angle
too; to bound what the shaft alone tells, give a camera without shadow.
"""

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.geometry import Vec, rotate, unit
from haptigraph.sim.eye.camera import Camera
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.painter import FloatImage, distance_map
from haptigraph.sim.robot.robot import Pose

__all__ = ["AngleBound", "angle_bound"]

STEP_PX = 0.25  # far more than the renderer's 1/32 px, far less than an edge is wide
OUTSIDE_MM = 12.0  # of shaft in view beyond the wall: the lever there


class AngleBound(Struct, frozen=True):
    """Least deviation of theta from one image [deg]; depth is unknown in all of them."""

    inside_deg: float
    """Only the inside of the globe is looked at, and where the needle pivots is known exactly."""
    inside_rcm_free_deg: float
    """Only the inside, and the pivot may lie anywhere across the shaft."""
    both_deg: float
    """Both sides of the wall, pivot known."""
    both_rcm_free_deg: float
    """Both sides, pivot unknown."""


def angle_bound(camera: Camera, eye: Eye, pose: Pose) -> AngleBound:
    """Return the bound for one pose.

    Args:
        camera: What sees the needle.
        eye: Whose trocar the needle goes through.
        pose: Of the needle.
    """
    px_per_mm = 1 / camera.geometry.mm_per_px
    distance_px = distance_map(camera.settings.width_px, camera.settings.height_px, camera.settings.center_px)
    is_inside = distance_px < eye.radius_mm * px_per_mm
    reach_mm = max(abs(pose.depth_mm), 1.0)
    inside = _information(camera, eye, pose, is_inside, STEP_PX / px_per_mm / reach_mm)
    outside = _information(camera, eye, pose, ~is_inside, STEP_PX / px_per_mm / OUTSIDE_MM)
    return AngleBound(
        inside_deg=_sd_deg(inside, rcm_known=True),
        inside_rcm_free_deg=_sd_deg(inside, rcm_known=False),
        both_deg=_sd_deg(inside + outside, rcm_known=True),
        both_rcm_free_deg=_sd_deg(inside + outside, rcm_known=False),
    )


def _information(
    camera: Camera, eye: Eye, pose: Pose, counted: NDArray[np.bool_], turn: float
) -> NDArray[np.float64]:
    """Return the Fisher information of (angle [rad], depth [mm], pivot across the shaft [mm]), (3, 3).

    Args:
        camera: What sees the needle.
        eye: Whose trocar it goes through.
        pose: Of the needle.
        counted: The pixels that are looked at, (h, w).
        turn: Step of the angle for the derivative [rad].
    """
    _, deviation = camera.expect(*_place(eye, pose))
    step_mm = STEP_PX * camera.geometry.mm_per_px
    steps = np.diag([turn, step_mm, step_mm])
    slopes = np.array(
        [
            (_expected(camera, eye, pose, step) - _expected(camera, eye, pose, -step))[counted]
            / (2 * step.sum())
            / deviation[counted]
            for step in steps
        ],
        np.float64,
    )
    information: NDArray[np.float64] = slopes @ slopes.T
    return information


def _sd_deg(information: NDArray[np.float64], *, rcm_known: bool) -> float:
    """Return the least deviation of the angle; infinite if the image tells nothing of it."""
    known = information[:2, :2] if rcm_known else information
    if np.linalg.matrix_rank(known) < len(known):
        return float("inf")
    return float(np.degrees(np.sqrt(np.linalg.inv(known)[0, 0])))


def _expected(camera: Camera, eye: Eye, pose: Pose, step: NDArray[np.float64]) -> FloatImage:
    grey, _ = camera.expect(*_place(eye, pose, *(float(value) for value in step)))
    return grey


def _place(
    eye: Eye, pose: Pose, turn: float = 0.0, deeper_mm: float = 0.0, across_mm: float = 0.0
) -> tuple[Vec, Vec]:
    """Return tip [mm] and direction of a pose, changed a little."""
    x, y = eye.trocar_mm
    along = rotate(unit((-x, -y)), pose.pitch_deg + float(np.degrees(turn)))
    depth_mm = pose.depth_mm + deeper_mm
    tip_mm = (
        x + depth_mm * along[0] - across_mm * along[1],
        y + depth_mm * along[1] + across_mm * along[0],
    )
    return tip_mm, along
