"""The detected needle -> its pose in space: a matrix, a covariance.

Origin at the tip, z along the shaft towards the tip. An image does not show how the needle is rolled about
its shaft; by convention, x lies in the section, and y points away from the viewer.
"""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptigraph.geometry import Point, Segment
from haptigraph.messages import Certainty, Observation

__all__ = [
    "UNKNOWN_SD_M",
    "UNKNOWN_SD_RAD",
    "Matrix",
    "found_needle",
    "needle_matrix",
    "pose_covariance",
]

Matrix: TypeAlias = tuple[tuple[float, float, float, float], ...]
"""Three rows of four: rotation, and in the last column the translation [mm]."""

UNKNOWN_SD_M, UNKNOWN_SD_RAD = 0.024, math.pi
"""Standard deviations of what is not known: the diameter of the globe, half a turn."""


def found_needle(observation: Observation) -> tuple[Segment, Point] | None:
    """Return the shaft and the tip of the needle; None unless both were detected."""
    line, tip = observation.found.get("needle_line"), observation.found.get("needle_tip")
    return (line, tip) if isinstance(line, Segment) and isinstance(tip, Point) else None


def needle_matrix(line: Segment, tip: Point) -> Matrix:
    """Return the needle's pose: origin at its tip, z along the shaft towards the tip, as SlicerIGT's model.

    Args:
        line: The visible shaft; eye frame.
        tip: Its tip, which for a bevel is beside the line.
    """
    length_mm = math.hypot(*line.along_mm)
    x, y, z = (each / length_mm for each in line.along_mm) if length_mm else (0.0, -1.0, 0.0)
    in_section = math.hypot(x, y)  # the model's x axis lies in the section
    right, up = (y / in_section, -x / in_section) if in_section else (1.0, 0.0)
    (at_x, at_y), at_z = tip.at_mm, tip.z_mm
    return (right, -z * up, x, at_x), (up, z * right, y, at_y), (0.0, x * up - y * right, z, at_z)


def pose_covariance(matrix: Matrix, certainty: Certainty | None, *, is_volume: bool) -> NDArray[np.float64]:
    """Return the covariance of a pose, (6, 6): x, y, z [m], rotations about x, y, z [rad], fixed axes.

    What a perceiver does not estimate has the variance of `UNKNOWN_SD_M` and `UNKNOWN_SD_RAD`: out of the
    section for any image but a volume, the roll about the shaft always. Position and rotation are correlated
    by an unknown amount, which is left out.

    Args:
        matrix: The pose.
        certainty: What the perceiver says of its needle, if it does.
        is_volume: Whether tip and shaft were located in three dimensions.
    """
    tip_sd_mm = certainty.tip_sd_mm if certainty else None
    tip_var_m2 = UNKNOWN_SD_M**2 if tip_sd_mm is None else (tip_sd_mm / 1e3) ** 2
    angle_var = math.radians(certainty.theta_sd_deg) ** 2 if certainty else UNKNOWN_SD_RAD**2
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = np.diag([tip_var_m2, tip_var_m2, tip_var_m2 if is_volume else UNKNOWN_SD_M**2])
    shaft = np.array([row[2] for row in matrix])
    known = np.eye(3) - np.outer(shaft, shaft) if is_volume else np.diag([0.0, 0.0, 1.0])
    covariance[3:, 3:] = angle_var * known + UNKNOWN_SD_RAD**2 * (np.eye(3) - known)
    return covariance
