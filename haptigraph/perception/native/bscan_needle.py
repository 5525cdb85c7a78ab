"""The needle in a B-scan: ridges and the edge of the shadow (`bscan_ridges.c`, `bscan_shadow.c`)."""

import ctypes
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptigraph.imaging import Floats, Mask
from haptigraph.messages import Image
from haptigraph.perception.native.arrays import BOOL, BYTE, INT, address, checked
from haptigraph.perception.native.bscan import DOUBLE, MAX_ROWS, MAX_SCAN_PX, ScanGrid
from haptigraph.perception.native.library import LIBRARY, pack

__all__ = [
    "ALONG_STEPS",
    "CORE_STEPS",
    "EdgeSearch",
    "RidgeLine",
    "RidgeSearch",
    "find_ridges",
    "shadow_edge",
]

MAX_RIDGES = LIBRARY.constant("MAX_RIDGES")
ALONG_STEPS, CORE_STEPS = LIBRARY.constant("ALONG_STEPS"), LIBRARY.constant("CORE_STEPS")
"""Averaged along and across a ridge."""

_RIDGE_SEARCH = LIBRARY.layout(
    "RidgeSearch",
    ("d", "step_px dark_grey mask_grey strip_grey lowest_slope highest_slope inlier_steps"),
    ("i", "across down side votes erased gap run beyond"),
)
_RIDGE_LINE = LIBRARY.layout("RidgeLine", ("d", "start_px along_px angle_sd_rad"), ("i", "stations"))

_EDGE_SEARCH = LIBRARY.layout(
    "EdgeSearch",
    ("d", "start_px along_px end_x margin_px window_px max_distance_px"),
    ("d", "thick_rows most_rows below_rows below_shaft_rows deep_rows below_rpe_rows"),
    *(("d", "min_contrast_grey level rise_share"), ("i", "slope_columns run half")),
)

_find_ridges = LIBRARY.function("find_ridges", "piipppippp", ctypes.c_int)

_shadow_edge = LIBRARY.function("shadow_edge", "piipipppppp", ctypes.c_int)


class RidgeSearch(NamedTuple):
    """Limits of the search for ridges, as in bscan.h; lengths along and across a ridge in steps."""

    step_px: float
    dark_grey: float
    mask_grey: float
    strip_grey: float
    lowest_slope: float
    highest_slope: float
    inlier_steps: float
    across: int
    down: int
    side: int
    votes: int
    erased: int
    gap: int
    run: int
    beyond: int

    def checked(self) -> bytes:
        """Return the limits for C."""
        finite = all(math.isfinite(value) for value in self)
        counts = self.across, self.down, self.side, self.votes
        valid = finite and 0.05 <= self.step_px <= 20 and 0 < self.lowest_slope < self.highest_slope
        if not valid or min(counts) < 1 or min(self[11:]) < 0 or max(*counts, *self[11:]) > MAX_ROWS:
            raise ValueError(f"ridges: expected positive lengths and slopes, found {self}")
        if not (0 <= self.dark_grey <= 1000 and 0 <= self.mask_grey <= 1000):
            raise ValueError(f"ridges: expected grey levels of 0 to 1000, found {self}")
        return pack(_RIDGE_SEARCH, *self)


class EdgeSearch(NamedTuple):
    """A shaft, and limits of the search for the edge of its shadow, as in bscan.h."""

    start_px: tuple[float, float]
    along_px: tuple[float, float]
    end_px: float
    margin_px: float
    window_px: float
    max_distance_px: float
    thick_rows: float
    most_rows: float
    below_rows: float
    below_shaft_rows: float
    deep_rows: float
    below_rpe_rows: float
    min_contrast_grey: float
    level: float
    rise_share: float
    slope_columns: int
    run: int
    half: int

    def checked(self) -> bytes:
        """Return the limits for C."""
        (x, y), (dx, dy) = self.start_px, self.along_px
        if not all(abs(value) <= MAX_SCAN_PX for value in (x, y, dx, dy, *self[2:])) or not dx:
            raise ValueError(f"edge: expected a slanted shaft and lengths to {MAX_SCAN_PX}, found {self}")
        if min(self.slope_columns, self.run) < 1 or self.half < 0:
            raise ValueError(f"edge: expected positive numbers of columns, found {self}")
        return pack(_EDGE_SEARCH, x, y, dx, dy, *self[2:])


class RidgeLine(NamedTuple):
    """A ridge: a straight line from its entry into the image downwards."""

    start_px: tuple[float, float]
    along_px: tuple[float, float]
    """Direction, length 1."""
    angle_sd_rad: float
    contrast_grey: NDArray[np.float32]
    """Brightness over that of the sides at each step, (n,)."""
    brighter_grey: NDArray[np.float32]
    """Brightness of the brighter side, (n,)."""


def find_ridges(
    image: Image, grid: ScanGrid, search: RidgeSearch, limit_row: NDArray[np.int32]
) -> list[RidgeLine]:
    """Return the ridges that may be shafts, those with most evidence first.

    Args:
        image: (h, w) grey.
        grid: The same, downsampled.
        search: Limits.
        limit_row: Last row of the grid in which a ridge is searched, by its columns, (columns,).
    """
    height, width = np.shape(image)
    pixels = checked("image", image, BYTE, (height, width))
    if max(height, width) > MAX_SCAN_PX:
        raise ValueError(f"image: expected at most {MAX_SCAN_PX} px, found {width} x {height}")
    limits = checked("limit_row", limit_row, INT, grid.cells.shape[1:])
    room = math.ceil(math.hypot(width, height) / search.step_px) + 1
    contrast, brighter = np.empty((2, MAX_RIDGES, room), np.float32)
    lines = ctypes.create_string_buffer(MAX_RIDGES * _RIDGE_LINE.size)
    count = _find_ridges(
        *(pixels, width, height, grid.native, search.checked(), limits, room, lines),
        *(address(contrast), address(brighter)),
    )
    if count < 0:
        raise MemoryError
    found = []
    for number in range(count):
        start, along, angle_sd_rad, stations = _line(lines, number)
        found.append(
            RidgeLine(start, along, angle_sd_rad, contrast[number, :stations], brighter[number, :stations])
        )
    return found


def _line(lines: Any, number: int) -> tuple[tuple[float, float], tuple[float, float], float, int]:
    """Return start, direction, its standard deviation and the stations of one line."""
    x, y, dx, dy, angle_sd_rad, stations = _RIDGE_LINE.unpack_from(lines, number * _RIDGE_LINE.size)
    return (x, y), (dx, dy), angle_sd_rad, stations


def shadow_edge(
    image: Image,
    search: EdgeSearch,
    x_px: Floats,
    ilm_px: Floats,
    ilm_visible: Mask,
    rpe_px: Floats,
    rpe_visible: Mask,
) -> tuple[float, float] | None:
    """Return the column of the shadow's edge near a shaft's end, and its width; None if there is none.

    Args:
        image: (h, w) grey.
        search: The shaft, and limits.
        x_px: Columns of the surfaces, ascending, (n,).
        ilm_px: Rows of the ILM, (n,).
        ilm_visible: Where it is visible, (n,).
        rpe_px: Rows of the RPE, (n,).
        rpe_visible: Where it is visible, (n,).
    """
    height, width = np.shape(image)
    pixels = checked("image", image, BYTE, (height, width))
    if max(height, width) > MAX_SCAN_PX:
        raise ValueError(f"image: expected at most {MAX_SCAN_PX} px, found {width} x {height}")
    count = len(x_px)
    columns = (x_px, DOUBLE), (ilm_px, DOUBLE), (ilm_visible, BOOL), (rpe_px, DOUBLE), (rpe_visible, BOOL)
    arrays = [checked("surface", array, dtype, (count,)) for array, dtype in columns]
    edge = np.empty(2)
    found = _shadow_edge(pixels, width, height, search.checked(), count, *arrays, address(edge))
    if found < 0:
        raise MemoryError
    return (float(edge[0]), float(edge[1])) if found else None
