"""How well bevelled cylinders explain where light stops in the A-scans of a volume (`volume_needle.c`)."""

import numpy as np

from haptigraph.imaging import FloatImage, Floats
from haptigraph.perception.native.arrays import FLOAT, address, checked
from haptigraph.perception.native.library import LIBRARY

__all__ = ["needle_scores"]

DOUBLE = np.dtype(np.float64)
POSE = 13
MAX_COUNT = 1 << 20

_needle_scores = LIBRARY.function("needle_scores", "pipidpipip")


def needle_scores(at: Floats, stops: FloatImage, axial_mm: float, poses: Floats, beam_mm: Floats) -> Floats:
    """Return the evidence of all A-scans for each needle, (p,).

    Args:
        at: Position x, z and weight of each A-scan, (m, 3).
        stops: Evidence that the metal's upper side is at each row, (m, h).
        axial_mm: Distance of two rows; the eye frame's origin is in the middle.
        poses: Direction, point of the axis, normal of the bevel's face, sharp end, radius, (p, 13).
        beam_mm: Displacements (x, z) across the beam over which the evidence is averaged, (b, 2).
    """
    counts = len(at), stops.shape[1], len(poses), len(beam_mm)
    if not (counts[1] >= 2 and counts[3] >= 1 and max(counts) < MAX_COUNT) or not axial_mm > 0:
        raise ValueError(
            f"expected A-scans of 2 rows or more, and a positive scale; found {counts}, {axial_mm}"
        )
    scores = np.empty(len(poses), np.float64)
    _needle_scores(
        checked("at", at, DOUBLE, (len(at), 3)),
        len(at),
        checked("stops", stops, FLOAT, (len(at), counts[1])),
        counts[1],
        float(axial_mm),
        checked("poses", poses, DOUBLE, (len(poses), POSE)),
        len(poses),
        checked("beam_mm", beam_mm, DOUBLE, (len(beam_mm), 2)),
        len(beam_mm),
        address(scores),
    )
    return scores
