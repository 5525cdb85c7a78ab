"""How sharp something is across a shaft.

Turns lanes across a shaft into how much the sharpest one differs from those beside it. The edges of metal and
a thin point are sharp; the edge of a shadow, a bubble and what is out of focus are not. Knows no tip.
"""

import ctypes

import numpy as np

from haptigraph.imaging import FloatImage
from haptigraph.perception.native.library import address, function, rows

__all__ = ["AROUND_PX", "is_sharp", "least_sharpness", "mean_sharpness", "sharpness"]

AROUND_PX = 6
"""To either side of a shaft's middle, that tells how sharp its point is."""

_sharpness = function("sharpness", "pniip")
_mean_sharpness = function("mean_sharpness", "pnii", ctypes.c_double)
_is_sharp = function("is_sharp", "pniidd", ctypes.c_int)
_least_sharpness = function("least_sharpness", "di", ctypes.c_double)


def sharpness(excess: FloatImage) -> FloatImage:
    """Return how much the sharpest lane differs from those beside it, (n,) grey levels.

    Args:
        excess: Lanes across the shaft, (lanes, n), nine at least.
    """
    lanes, stations = excess.shape
    sharpness_grey = np.empty(stations, np.float32)
    _sharpness(*rows(excess), lanes, stations, address(sharpness_grey))
    return sharpness_grey


def mean_sharpness(excess: FloatImage) -> float:
    """Return how much the sharpest lane of the mean of all stations differs from those beside it [grey].

    Args:
        excess: Lanes across the shaft, (lanes, n), nine at least.
    """
    return float(_mean_sharpness(*rows(excess), *excess.shape))


def is_sharp(excess: FloatImage, share: float, noise_grey: float) -> bool:
    """Tell whether the mean of all stations is sharper than noise, and than a share of its own contrast.

    Args:
        excess: Lanes across the shaft, (lanes, n), nine at least.
        share: Of the contrast.
        noise_grey: Standard deviation of a pixel.
    """
    return bool(_is_sharp(*rows(excess), *excess.shape, share, noise_grey))


def least_sharpness(noise_grey: float, stations: int) -> float:
    """Return how sharp the mean of so many stations must be so that noise does not explain it."""
    return float(_least_sharpness(noise_grey, stations))
