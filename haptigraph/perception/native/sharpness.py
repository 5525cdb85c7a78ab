"""Sharpness across a shaft: how much the sharpest lane differs from those beside it (`sharpness.c`).

The edges of metal and a thin point are sharp; the edge of a shadow, a bubble and a defocused object are not.
"""

import ctypes
from operator import index

import numpy as np

from haptigraph.imaging import FloatImage
from haptigraph.perception.native.arrays import MAX_STATIONS, address, checked_rows
from haptigraph.perception.native.library import LIBRARY

__all__ = ["AROUND_PX", "mean_sharpness", "sharpness", "sharpness_threshold"]

AROUND_PX = LIBRARY.constant("AROUND_PX")
"""To either side of a shaft's middle, in which the sharpness of its point is measured."""

_sharpness = LIBRARY.function("sharpness", "pniiip")
_mean_sharpness = LIBRARY.function("mean_sharpness", "pnii", ctypes.c_double)
_sharpness_threshold = LIBRARY.function("sharpness_threshold", "di", ctypes.c_double)


def sharpness(excess: FloatImage, group: int) -> FloatImage:
    """Return the sharpness of the mean of each so many stations in a row, (n + 1 - group,) grey levels.

    Args:
        excess: Lanes across the shaft, (lanes, n).
        group: Stations, 1 to n.
    """
    rows = checked_rows("excess", excess)
    if not 0 < index(group) <= rows[3]:
        raise ValueError(f"group: expected 1 to {rows[3]} stations, found {group}")
    sharpness_grey = np.empty(rows[3] + 1 - group, np.float32)
    _sharpness(*rows, group, address(sharpness_grey))
    return sharpness_grey


def mean_sharpness(excess: FloatImage) -> float:
    """Return the sharpness of the mean of all stations [grey levels]; 0 without stations.

    Args:
        excess: Lanes across the shaft, (lanes, n).
    """
    return float(_mean_sharpness(*checked_rows("excess", excess)))


def sharpness_threshold(noise_grey: float, stations: int) -> float:
    """Return the sharpness [grey levels] that noise does not reach in the mean of so many stations."""
    if not 0 < stations <= MAX_STATIONS:
        raise ValueError(f"stations: expected 1 to {MAX_STATIONS}, found {stations}")
    return float(_sharpness_threshold(float(noise_grey), index(stations)))
