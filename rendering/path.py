"""The needle's path: depth and angle in every image.

It enters at an angle, turns towards the target and advances until it touches the retina, with tremor.
"""

import math

from msgspec import Struct

__all__ = ["IMAGES", "Pose", "needle_path"]

IMAGES = 36
INCOMING = TURNING = 10  # images; the others are the approach
FIRST_MM, STOP_MM, TURN_MM = -2.5, 4.0, 6.0  # depth at the start, and at the start and end of the turn
BEYOND_MM = 0.05  # final depth in the retina
SWAY_DEG = 0.15
TREMBLE_MM, TREMBLE_DEG = 0.03, 0.1


class Pose(Struct, frozen=True):
    """Pose of the needle in one image."""

    depth_mm: float
    """From the remote centre of motion to the tip, along the shaft; negative outside."""
    theta_deg: float
    """From the line trocar -> target to the shaft, counter-clockwise."""


def needle_path(trocar_to_target_mm: float, start_deg: float) -> tuple[Pose, ...]:
    """Return the pose in every image.

    Args:
        trocar_to_target_mm: Distance from the trocar to the target.
        start_deg: Theta during entry.
    """
    last_mm = trocar_to_target_mm + BEYOND_MM
    return tuple(_trembling(number, _steady(number, last_mm, start_deg)) for number in range(IMAGES))


def _steady(number: int, last_mm: float, start_deg: float) -> Pose:
    """Return the pose without tremor."""
    if number < INCOMING:
        return Pose(FIRST_MM + (STOP_MM - FIRST_MM) * number / INCOMING, start_deg)
    if number < INCOMING + TURNING:
        share = (number - INCOMING) / TURNING
        return Pose(STOP_MM + (TURN_MM - STOP_MM) * share, start_deg * (1 - share) ** 2)
    share = (number - INCOMING - TURNING + 1) / (IMAGES - INCOMING - TURNING)
    depth_mm = TURN_MM + (last_mm - TURN_MM) * math.sin(share * math.pi / 2)
    return Pose(depth_mm, SWAY_DEG * math.sin(number))


def _trembling(number: int, pose: Pose) -> Pose:
    return Pose(
        pose.depth_mm + TREMBLE_MM * math.sin(1.7 * number),
        pose.theta_deg + TREMBLE_DEG * math.sin(2.3 * number + 1),
    )
