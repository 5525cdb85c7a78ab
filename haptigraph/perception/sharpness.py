"""How sharp something is across a shaft.

Turns lanes across a shaft into how much the sharpest one differs from those beside it. The edges of metal and
a thin point are sharp; the edge of a shadow, a bubble and what is out of focus are not. Knows no tip.
"""

import math
from functools import cache

import numpy as np

from haptigraph.perception.pixels import FloatImage
from haptigraph.perception.tip import LEAST_SNR

__all__ = ["AROUND_PX", "is_sharp", "least_sharpness", "sharpness"]

BESIDE_PX = 2  # from lane to lane: an edge or a point changes over so little, the edge of a shadow does not
BESIDE = np.array((1, -4, 6, -4, 1), np.float32) / 6
SHARP_NOISE = float(np.sqrt((BESIDE**2).sum()))
SHARP_REACH_PX = BESIDE_PX * (len(BESIDE) // 2)  # to either side of a lane, that tells how sharp it is
AROUND_PX = 6
"""To either side of a shaft's middle, that tells how sharp its point is."""


def sharpness(excess: FloatImage) -> FloatImage:
    """Return how much the sharpest lane differs from those beside it, (n,) grey levels.

    Args:
        excess: Lanes across the shaft, (lanes, n), more than twice SHARP_REACH_PX.
    """
    return np.asarray(np.abs(_sharp(len(excess)) @ excess).max(axis=0), np.float32)


def is_sharp(excess: FloatImage, share: float, noise_grey: float) -> bool:
    """Tell whether the mean of all stations is sharper than noise, and than a share of its own contrast.

    Args:
        excess: Lanes across the shaft, (lanes, n), more than twice SHARP_REACH_PX.
        share: Of the contrast.
        noise_grey: Standard deviation of a pixel.
    """
    stations = excess.shape[1]
    mean = excess @ np.full((stations, 1), 1 / stations, np.float32)
    contrast = float(np.abs(mean[SHARP_REACH_PX:-SHARP_REACH_PX]).max())
    return float(sharpness(mean)[0]) >= max(share * contrast, least_sharpness(noise_grey, stations))


def least_sharpness(noise_grey: float, stations: int) -> float:
    """Return how sharp the mean of so many stations must be so that noise does not explain it."""
    return LEAST_SNR * SHARP_NOISE * noise_grey / math.sqrt(stations)


@cache
def _sharp(lanes: int) -> FloatImage:
    """Return what takes from every lane the cubic through four lanes beside it, (lanes - 8, lanes)."""
    last = 2 * SHARP_REACH_PX
    sharp = np.zeros((lanes - last, lanes), np.float32)
    for lane in range(len(sharp)):
        sharp[lane, lane : lane + last + 1 : BESIDE_PX] = BESIDE
    return sharp
