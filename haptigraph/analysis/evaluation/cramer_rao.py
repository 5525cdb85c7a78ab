"""The Cramer-Rao bound of the shaft's angle, given the sensor's noise.

No unbiased estimate from one image has a smaller standard deviation (Kay 1993, Fundamentals of Statistical
Signal Processing I, section 3.5: Gaussian noise, unknown mean). The simulator's noise is the same in all
three colours, so a pixel counts once, as grey. Quantisation to 8 bits is neglected. The shadow carries
information about the angle, too; for the bound of the shaft alone, use a camera without shadow.
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

STEP_PX = 0.25  # far above the renderer's 1/32 px, far below the width of an edge
OUTSIDE_MM = 12.0  # lever: length of shaft visible outside the wall


class AngleBound(Struct, frozen=True):
    """Minimum standard deviation of theta from one image [deg]; the depth is unknown in all of them."""

    inside_deg: float
    """From the inside of the globe only; the remote centre of motion (RCM) is known exactly."""
    inside_rcm_free_deg: float
    """From the inside only; the RCM may be anywhere across the shaft."""
    both_deg: float
    """From both sides of the wall; RCM known."""
    both_rcm_free_deg: float
    """From both sides; RCM unknown."""


def angle_bound(camera: Camera, eye: Eye, pose: Pose) -> AngleBound:
    """Return the bound for one pose.

    Args:
        camera: The camera.
        eye: The eye whose trocar the needle passes.
        pose: Pose of the needle.
    """
    px_per_mm = 1 / camera.geometry.mm_per_px
    distance_px = distance_map(camera.settings.width_px, camera.settings.height_px, camera.settings.center_px)
    is_inside = distance_px < eye.radius_mm * px_per_mm
    lever_mm = max(abs(pose.depth_mm), 1.0)
    inside = _information(camera, eye, pose, is_inside, STEP_PX / px_per_mm / lever_mm)
    outside = _information(camera, eye, pose, ~is_inside, STEP_PX / px_per_mm / OUTSIDE_MM)
    return AngleBound(
        inside_deg=_sd_deg(inside, rcm_known=True),
        inside_rcm_free_deg=_sd_deg(inside, rcm_known=False),
        both_deg=_sd_deg(inside + outside, rcm_known=True),
        both_rcm_free_deg=_sd_deg(inside + outside, rcm_known=False),
    )


def _information(
    camera: Camera, eye: Eye, pose: Pose, mask: NDArray[np.bool_], angle_step: float
) -> NDArray[np.float64]:
    """Return the Fisher information of (angle [rad], depth [mm], RCM across the shaft [mm]), (3, 3).

    Args:
        camera: The camera.
        eye: The eye whose trocar the needle passes.
        pose: Pose of the needle.
        mask: The pixels that count, (h, w).
        angle_step: Step of the angle for the derivative [rad].
    """
    _, noise_sd = camera.expect(*_tip_and_direction(eye, pose))
    step_mm = STEP_PX * camera.geometry.mm_per_px
    steps = np.diag([angle_step, step_mm, step_mm])
    jacobian = np.array(
        [
            (_expected(camera, eye, pose, step) - _expected(camera, eye, pose, -step))[mask]
            / (2 * step.sum())
            / noise_sd[mask]
            for step in steps
        ],
        np.float64,
    )
    information: NDArray[np.float64] = jacobian @ jacobian.T
    return information


def _sd_deg(information: NDArray[np.float64], *, rcm_known: bool) -> float:
    """Return the minimum standard deviation of the angle; infinite if the image does not determine it."""
    unknowns = information[:2, :2] if rcm_known else information
    if np.linalg.matrix_rank(unknowns) < len(unknowns):
        return float("inf")
    return float(np.degrees(np.sqrt(np.linalg.inv(unknowns)[0, 0])))


def _expected(camera: Camera, eye: Eye, pose: Pose, step: NDArray[np.float64]) -> FloatImage:
    grey, _ = camera.expect(*_tip_and_direction(eye, pose, *(float(value) for value in step)))
    return grey


def _tip_and_direction(
    eye: Eye, pose: Pose, angle_step: float = 0.0, depth_step_mm: float = 0.0, across_mm: float = 0.0
) -> tuple[Vec, Vec]:
    """Return the tip [mm] and direction of a pose plus a small step."""
    x, y = eye.trocar_mm
    along = rotate(unit((-x, -y)), pose.pitch_deg + float(np.degrees(angle_step)))
    depth_mm = pose.depth_mm + depth_step_mm
    tip_mm = (
        x + depth_mm * along[0] - across_mm * along[1],
        y + depth_mm * along[1] + across_mm * along[0],
    )
    return tip_mm, along
