"""Rewards of surfaces in a volume, and the best paths through its slices (`volume_surfaces.c`)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptigraph.imaging import FloatImage
from haptigraph.perception.native.arrays import FLOAT, address, checked
from haptigraph.perception.native.library import LIBRARY

__all__ = ["IlmRewards", "RpeRewards", "best_paths", "ilm_rewards", "row_sums", "rpe_rewards"]

MAX_SIZE = 1 << 14

_row_sums = LIBRARY.function("row_sums", "piiiip")
_ilm_rewards = LIBRARY.function("ilm_rewards", "piiiiifpppp")
_rpe_rewards = LIBRARY.function("rpe_rewards", "piiiiippppp")
_volume_paths = LIBRARY.function("volume_paths", "piiipipp")


class IlmRewards(NamedTuple):
    """By row, slice and cell, (h, n, k) each; the first two are averaged with neighbouring slices."""

    reward: FloatImage
    step: FloatImage
    """From dark to bright [grey]."""
    rise: FloatImage
    """Contrast of the tissue below against what is above [grey]."""


class RpeRewards(NamedTuple):
    """By row, slice and cell, (h, n, k) each; the first two are averaged with neighbouring slices."""

    reward: FloatImage
    smooth_rise: FloatImage
    rise: FloatImage
    """Contrast of a band against what is above [grey]."""
    fall: FloatImage
    """Contrast of a band against what is below [grey]."""


def ilm_rewards(grey: FloatImage, dark_grey: float, edge: int, deep: int) -> IlmRewards:
    """Return how well the ILM fits at each row.

    Args:
        grey: (h, n, k).
        dark_grey: Brightness without backscatter.
        edge: Rows that are averaged on either side of a step.
        deep: Rows of tissue below the ILM.
    """
    if not 1 <= edge <= deep or deep < 2:
        raise ValueError(f"expected 1 <= edge <= deep and 2 <= deep; found {edge} and {deep}")
    rows, slices, cells = _shape(grey)
    sums = row_sums(grey, deep, deep)
    buffer = np.empty((2, slices, cells), np.float32)
    out = IlmRewards(*(np.empty(grey.shape, np.float32) for _ in range(3)))
    _ilm_rewards(
        address(sums), rows, slices, cells, edge, deep, float(dark_grey), address(buffer), *map(address, out)
    )
    return out


def rpe_rewards(grey: FloatImage, edge: int, band: int) -> RpeRewards:
    """Return how well the RPE fits at each row.

    Args:
        grey: (band + h + 4 * band, n, k).
        edge: Rows that are averaged on either side of a step.
        band: Thickness of the RPE in rows.
    """
    rows, slices, cells = _shape(grey)
    rows -= 5 * band
    if not 1 <= edge <= band or rows < 1:
        raise ValueError(f"expected 1 <= edge <= band and more than 5 bands; found {edge}, {band} and {rows}")
    sums, buffer = row_sums(grey, 0, 0), np.empty((slices, cells), np.float32)
    out = RpeRewards(*(np.empty((rows, slices, cells), np.float32) for _ in range(4)))
    _rpe_rewards(address(sums), rows, slices, cells, edge, band, address(buffer), *map(address, out))
    return out


def row_sums(grey: FloatImage, above: int, below: int) -> FloatImage:
    """Return the sums of the first 0, 1, 2, ... rows, (above + h + below + 1, n, k).

    Args:
        grey: (h, n, k).
        above: How often the first row is repeated before.
        below: How often the last row is repeated after.
    """
    rows, slices, cells = _shape(grey)
    if not (0 <= above < MAX_SIZE and 0 <= below < MAX_SIZE):
        raise ValueError(f"expected 0 to {MAX_SIZE} more rows, found {above} and {below}")
    sums = np.empty((above + rows + below + 1, slices, cells), np.float32)
    _row_sums(address(grey), rows, slices * cells, above, below, address(sums))
    return sums


def best_paths(reward: FloatImage, step_cost: FloatImage) -> NDArray[np.int32]:
    """Return the row of the best path in each cell of each slice, (n, k).

    Args:
        reward: Reward of each voxel, (h, n, k).
        step_cost: Cost of moving up or down by -(c // 2) to c // 2 rows to the next cell, (c,), c odd.
    """
    rows, slices, cells = _shape(reward)
    if len(step_cost) % 2 != 1 or len(step_cost) >= MAX_SIZE:
        raise ValueError(f"step_cost: expected an odd number of values, found {len(step_cost)}")
    half = len(step_cost) // 2
    buffer, paths = np.empty((cells, rows + 2 * half), np.float32), np.empty((slices, cells), np.int32)
    cost = checked("step_cost", step_cost, FLOAT, (2 * half + 1,))
    _volume_paths(address(reward), rows, slices, cells, cost, half, address(buffer), address(paths))
    return paths


def _shape(grey: FloatImage) -> tuple[int, int, int]:
    """Return the shape of a volume that C reads: contiguous float32, (h, n, k)."""
    if (
        type(grey) is not np.ndarray
        or grey.ndim != 3
        or not 0 < min(grey.shape) <= max(grey.shape) < MAX_SIZE
    ):
        raise ValueError(f"expected a volume of 1 to {MAX_SIZE} values a side, found {np.shape(grey)}")
    checked("volume", grey, FLOAT, grey.shape)
    rows, slices, cells = grey.shape
    return rows, slices, cells
