"""A line through places of which some are not on it.

Turns places with variances, and what unknowns do to them, into the unknowns: least squares without outliers,
from a line that is expected or from the one that most places agree on. Knows no shaft.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.perception.pixels import FloatImage, Floats, Mask
from haptigraph.perception.strip import median

__all__ = ["FROM_COMMON_PX", "Solution", "off_common_line", "solved"]

TUKEY = 4.0
ROUNDS = 3
MISS_PX = 3.0
LEAST_MISS_PX = 0.45
COMMON_PX = 0.75  # from the line most pairs are on
LEAST_APART_PX, MOST_TRIED = 30.0, 40  # of the pairs it is drawn through
FROM_COMMON_PX = 1.5
"""A pair so far off the common line may be on the right one."""


class Solution(NamedTuple):
    """Unknowns that explain where pairs lie."""

    answer: Floats
    covariance: Floats
    is_on: Mask
    """Pairs that agree with it, (2 n,)."""
    miss_px: Floats
    """Of every pair, (2 n,)."""
    scatter: float


def solved(
    design: Floats,
    v: Floats,
    trust: Floats,
    usable: NDArray[np.int64],
    light: tuple[Floats, Floats],
    miss_px: Floats,
    reach_px: float,
) -> Solution:
    """Solve for the unknowns by least squares, leaving out pairs that are off the line (Tukey's weights).

    Args:
        design: What each of them does to every pair, (6, 2 n).
        v: Where the pairs lie, (2 n,).
        trust: One over their variances, (2 n,).
        usable: Those that are there.
        light: What is known of the unknowns before.
        miss_px: How far the pairs are off the line it begins with, (2 n,).
        reach_px: How far those that are on it may be off that line.
    """
    prior, pull = light
    for number in range(ROUNDS):
        if number:
            reach_px = min(max(TUKEY * 1.4826 * median(np.abs(miss_px[usable])), LEAST_MISS_PX), MISS_PX)
        closeness = np.maximum(1 - np.square(miss_px * (1 / reach_px)), 0)
        weighed = design * (trust * closeness * closeness)
        covariance = cv2.invert(weighed @ design.T + prior, flags=cv2.DECOMP_CHOLESKY)[1]  # 4 times as fast
        answer = covariance @ (weighed @ v + pull)
        miss_px = v - answer @ design
    is_on = (closeness > 0) & (trust > 0)
    scatter = float((trust * is_on) @ np.square(miss_px)) / max(int(np.count_nonzero(is_on)) - 2, 1)
    return Solution(answer, covariance, is_on, miss_px, scatter)


def off_common_line(u_px: FloatImage, v: Floats, usable: NDArray[np.int64]) -> Floats:
    """Return how far every pair is off the line that most of them are on, (2 n,).

    Least squares trust a few wide pairs, as a bubble beside the shaft makes, more than all narrow ones.

    Args:
        u_px: Where the pairs lie along the strip, (2 n,).
        v: And across it, (2 n,).
        usable: Those that are there.
    """
    tried = usable[:: len(usable) // MOST_TRIED + 1]
    one, other = (tried[index] for index in np.triu_indices(len(tried), 1))
    along_px = u_px[other] - u_px[one]
    is_apart = np.abs(along_px) >= LEAST_APART_PX
    if not is_apart.any():
        return v
    slope = (v[other] - v[one])[is_apart] / along_px[is_apart]
    offset_px = v[one][is_apart] - slope * u_px[one][is_apart]
    off_px = v[usable] - offset_px[:, None] - slope[:, None] * u_px[usable]
    best = int(np.maximum(1 - np.square(off_px / COMMON_PX), 0).sum(axis=1).argmax())
    return np.asarray(v - offset_px[best] - slope[best] * u_px, np.float64)
