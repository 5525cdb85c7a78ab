"""The needle's path: how deep it is and where it points, image by image.

It comes in at an angle, turns towards the target, and is pushed on until it touches the retina, by a hand
that trembles. Knows neither the eye nor the needle's shape.
"""

import math

from msgspec import Struct

__all__ = ["IMAGES", "Pose", "needle_path"]

IMAGES = 36
INCOMING = TURNING = 10  # images; the rest is the way to the retina
FIRST_MM, STOP_MM, TURN_MM = -2.5, 4.0, 6.0  # where it begins, where it begins to turn, where it has turned
BEYOND_MM = 0.05  # pushed so far into the retina
SWAY_DEG = 0.15
TREMBLE_MM, TREMBLE_DEG = 0.03, 0.1


class Pose(Struct, frozen=True):
    """Where the needle is in one image."""

    depth_mm: float
    """From the trocar's pivot to the tip, along the shaft; negative outside."""
    theta_deg: float
    """From the line trocar -> target to the shaft, counter-clockwise."""


def needle_path(trocar_to_target_mm: float, start_deg: float) -> tuple[Pose, ...]:
    """Return the pose in every image.

    Args:
        trocar_to_target_mm: How far it is.
        start_deg: Theta on the way in.
    """
    last_mm = trocar_to_target_mm + BEYOND_MM
    return tuple(_trembling(number, _steady(number, last_mm, start_deg)) for number in range(IMAGES))


def _steady(number: int, last_mm: float, start_deg: float) -> Pose:
    """Return the pose of a hand that does not tremble."""
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
