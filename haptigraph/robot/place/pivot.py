"""The remote centre of motion of a robot that pivots: the point that is nearest to all its shafts."""

import math

import numpy as np
from msgspec import Struct

from haptigraph.errors import BadInput
from haptigraph.robot.pose import Floats

__all__ = ["Pivot", "fit_pivot"]

MIN_SHAFTS = 30
MIN_TURN_DEG = 3.0
MAX_RMS_MM = 0.5
BLOCKS = 10


class Pivot(Struct, frozen=True):
    """Where all shafts meet."""

    at_mm: Floats
    """In the robot's base, (3,)."""
    sd_mm: float
    """Standard deviation along the axis of the base along which it is largest."""
    rms_mm: float
    """RMS distance of the shafts from it."""
    turn_deg: float
    """RMS angle by which the shaft turned, in the direction in which it turned least."""


def fit_pivot(tips_mm: Floats, axes: Floats, what: str) -> Pivot:
    """Fit the remote centre of motion by least squares of the distances from the shafts.

    Its standard deviation is that of a jackknife that leaves out a tenth of the motion at a time, as errors
    of neighbouring poses resemble each other.

    Args:
        tips_mm: Tips in the robot's base, in the order of time, (n, 3).
        axes: Directions of the shaft, length 1, (n, 3).
        what: Names the motion in errors.

    Raises:
        BadInput: If the robot turned too little, or its shafts do not meet.
    """
    if len(tips_mm) < MIN_SHAFTS:
        raise BadInput(
            f"{len(tips_mm)} poses are too few for the pivot; at least {MIN_SHAFTS} are needed", what
        )
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    pulls = np.einsum("nij,nj->ni", across, tips_mm)
    turn_deg = math.degrees(
        math.asin(math.sqrt(float(np.linalg.eigvalsh(across.mean(axis=0))[0].clip(0, 1))))
    )
    if turn_deg < MIN_TURN_DEG:
        raise BadInput(
            f"the shaft turns by only {turn_deg:.1f}° RMS, so its pivot is not known along it; turn it by at "
            f"least {MIN_TURN_DEG:g}°",
            what,
        )
    at_mm = np.linalg.solve(across.sum(axis=0), pulls.sum(axis=0))
    offsets = np.einsum("nij,nj->ni", across, at_mm - tips_mm)
    rms_mm = math.sqrt(float((offsets**2).sum(axis=1).mean()))
    if rms_mm > MAX_RMS_MM:
        raise BadInput(
            f"the shafts do not meet: they pass the best point at {rms_mm:.2f} mm RMS, at most "
            f"{MAX_RMS_MM:g} mm is accepted; is shaft_axis right, and does the robot pivot in the trocar?",
            what,
        )
    parts = np.array_split(np.arange(len(tips_mm)), BLOCKS)
    matrix, vector = across.sum(axis=0), pulls.sum(axis=0)
    without = np.array(
        [np.linalg.solve(matrix - across[p].sum(axis=0), vector - pulls[p].sum(axis=0)) for p in parts]
    )
    variance = (BLOCKS - 1) / BLOCKS * np.square(without - without.mean(axis=0)).sum(axis=0)
    return Pivot(at_mm, math.sqrt(float(variance.max())), rms_mm, turn_deg)
