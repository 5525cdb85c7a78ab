"""Passes over a B-scan: downsampling, surfaces (`bscan_cells.c`, `bscan_surfaces.c`, `bscan_smoothing.c`)."""

import ctypes
from operator import index
from typing import Any, NamedTuple

import numpy as np
from msgspec import Struct
from msgspec.structs import force_setattr
from numpy.typing import NDArray

from haptigraph.imaging import FloatImage, Floats, Mask
from haptigraph.messages import Image
from haptigraph.perception.native.arrays import BOOL, BYTE, FLOAT, INT, address, checked
from haptigraph.perception.native.library import LIBRARY, pack

__all__ = [
    "FoundSurfaces",
    "GridLevels",
    "ScanGrid",
    "Smoothing",
    "SurfaceSearch",
    "average_cells",
    "best_path",
    "find_surfaces",
    "remove_specks",
    "sum_squares",
]

MAX_SQUARE_PX, MAX_STEP_ROWS, MAX_SCAN_PX, MAX_CELLS, MAX_SUM_CELLS = map(
    LIBRARY.constant,
    ("MAX_SQUARE_PX", "MAX_STEP_ROWS", "MAX_SCAN_PX", "MAX_CELLS", "MAX_SUM_CELLS"),
)
MIN_CELLS, MAX_ROWS = 8, 10_000
DOUBLE = np.dtype(np.float64)

_GRID = LIBRARY.layout("Grid", ("p", "cells"), ("i", "rows columns group"))
_SURFACE_SEARCH = LIBRARY.layout(
    "SurfaceSearch",
    ("i", "edge deep thinnest thickest band most min_columns"),
    ("d", "step_grey rpe_step_grey saturation_grey body_share dark_grey top_grey"),
    ("d", "min_rise_grey min_rise_share min_band_grey min_band_share border_rows"),
    *(("p", "ilm.window"), ("i", "ilm.reach"), ("d", "ilm.least_sd_rows ilm.scatter_share")),
    *(("p", "rpe.window"), ("i", "rpe.reach"), ("d", "rpe.least_sd_rows rpe.scatter_share")),
)
_sum_squares = LIBRARY.function("sum_squares", "piiiiipp")
_average_cells = LIBRARY.function("average_cells", "piddiipp")
_cell_levels = LIBRARY.function("cell_levels", "pp")
_best_path = LIBRARY.function("best_path", "piiipp", ctypes.c_int)
_find_surfaces = LIBRARY.function("find_surfaces", "ppppp", ctypes.c_int)
_remove_specks = LIBRARY.function("remove_specks", "pii")


class Smoothing(NamedTuple):
    """How a surface is smoothed, and its standard deviation estimated, as in bscan.h."""

    window: Floats
    """Positive weights of neighbouring columns, (k,), k odd."""
    least_sd_rows: float
    """Smallest standard deviation, in rows of the grid."""
    scatter_share: float
    """Standard deviation in those of the rows in the window."""

    def checked(self) -> tuple[int, int, float, float]:
        """Return the same for C."""
        reach = len(self.window) // 2
        window = checked("window", self.window, DOUBLE, (2 * reach + 1,))
        return window, reach, self.least_sd_rows, self.scatter_share


class SurfaceSearch(NamedTuple):
    """Limits of the search for both surfaces, as in bscan.h; lengths in rows of the grid."""

    edge: int
    deep: int
    thinnest: int
    thickest: int
    band: int
    most: int
    min_columns: int
    step_grey: float
    rpe_step_grey: float
    saturation_grey: float
    body_share: float
    dark_grey: float
    top_grey: float
    min_rise_grey: float
    min_rise_share: float
    min_band_grey: float
    min_band_share: float
    border_rows: float
    ilm: Smoothing
    rpe: Smoothing

    def checked(self) -> bytes:
        """Return the limits for C."""
        whole = self.edge, self.deep // 2, self.thinnest, self.band, self.most, self.min_columns
        valid = min(whole) > 0 and self.thickest >= self.thinnest + MIN_CELLS
        valid = valid and self.most <= MAX_STEP_ROWS
        if (
            not valid
            or max(*whole, self.deep, self.thickest) > MAX_ROWS
            or not 0 <= self.dark_grey <= self.top_grey <= 256
        ):
            raise ValueError(f"surfaces: expected lengths of 1 to {MAX_ROWS} rows, grey to 255; found {self}")
        return pack(_SURFACE_SEARCH, *self[:-2], *self.ilm.checked(), *self.rpe.checked())


class FoundSurfaces(NamedTuple):
    """ILM and RPE, by column of the surfaces; lengths in rows of the grid."""

    rows: Floats
    """Of ILM and RPE, (2, n)."""
    sds: Floats
    """Standard deviations of the rows, (2, n)."""
    visible: Mask
    """Where they are visible, (2, n)."""
    tissue_grey: float
    """Contrast of visible tissue against what is dark."""


class GridLevels(NamedTuple):
    """Grey levels of a downsampled image."""

    dark_grey: float
    """Without backscatter."""
    darkest_grey: float
    difference_grey: float
    """Median absolute difference of neighbouring cells."""
    bright_grey: float
    """Of tissue, if there is some."""

    @property
    def noise_grey(self) -> float:
        """Standard deviation of the noise of a column of the surfaces."""
        return max(self.dark_grey - self.darkest_grey, 1.0)


class ScanGrid(Struct, frozen=True, eq=False):
    """A downsampled B-scan."""

    cells: NDArray[np.int32]
    """Mean grey of each cell, in steps, (rows, columns)."""
    group: int
    """Cells side by side that make one column of the surfaces."""
    native: Any = None
    """The same for C; always made anew from the rest."""

    def __post_init__(self) -> None:
        rows, columns = np.shape(self.cells)
        if not (rows >= MIN_CELLS and self.group >= 1 and MIN_CELLS * self.group <= columns):
            raise ValueError(f"grid: expected at least {MIN_CELLS} rows and columns, found {rows}, {columns}")
        if max(rows, columns) > MAX_CELLS:
            raise ValueError(f"grid: expected at most {MAX_CELLS} cells, found {rows} x {columns}")
        cells = checked("cells", self.cells, INT, (rows, columns))
        force_setattr(self, "native", pack(_GRID, cells, rows, columns, self.group))

    @property
    def shape(self) -> tuple[int, int]:
        """Columns of the surfaces, and rows."""
        return self.cells.shape[1] // self.group, self.cells.shape[0]

    def check(self, padding: int) -> None:
        """Check that the sums of a column, with rows beyond the image, fit C's integers."""
        if (self.cells.shape[0] + padding + 1) * self.group > MAX_SUM_CELLS:
            raise ValueError(f"grid: expected columns of at most {MAX_SUM_CELLS} cells")

    def levels(self) -> GridLevels:
        """Return the grey levels of the image."""
        out = np.empty(4)
        _cell_levels(self.native, address(out))
        return GridLevels(*out.tolist())


def sum_squares(image: Image, across: int, down: int) -> NDArray[np.int32]:
    """Return the sum of the grey of squares of `across` x `down` pixels, (rows, columns).

    Args:
        image: (h, w) grey.
        across: Columns of a square.
        down: Rows of a square.
    """
    height, width = np.shape(image)
    pixels = checked("image", image, BYTE, (height, width))
    if not (1 <= across <= width and 1 <= down <= height and across * down <= MAX_SQUARE_PX):
        raise ValueError(f"squares: expected at most {MAX_SQUARE_PX} pixels, found {across} x {down}")
    rows, columns = height // down, width // across
    sums, squares = np.empty(width, np.uint16), np.empty((rows, columns), np.int32)
    _sum_squares(pixels, width, across, down, rows, columns, address(sums), address(squares))
    return squares


def average_cells(image: Image, across: float, down: float) -> NDArray[np.int32]:
    """Return the mean grey of cells of `across` x `down` pixels, in steps, (rows, columns).

    Args:
        image: (h, w) grey.
        across: Columns of a cell, at least 1.
        down: Rows of a cell, at least 1.
    """
    height, width = np.shape(image)
    pixels, across, down = checked("image", image, BYTE, (height, width)), float(across), float(down)
    if not (1 <= across <= width <= MAX_SCAN_PX and 1 <= down <= height <= MAX_SCAN_PX):
        raise ValueError(f"cells: expected 1 pixel to the image's size, found {across} x {down}")
    rows, columns = int(height / down), int(width / across)
    scratch = np.empty((3 * width + rows + columns + 6) // 2, np.uint64)
    cells = np.empty((rows, columns), np.int32)
    _average_cells(pixels, width, across, down, rows, columns, address(scratch), address(cells))
    return cells


def best_path(reward: FloatImage, step_cost: FloatImage) -> NDArray[np.int32]:
    """Return the row of the best path in each column, (w,).

    Args:
        reward: Reward of each pixel, (w, h): one row of the array per column of the image.
        step_cost: Cost of moving up or down by -(k // 2) to k // 2 rows to the next column, (k,), k odd;
            larger steps are excluded.
    """
    width, height = np.shape(reward)
    most = len(step_cost) // 2
    rewards = checked("reward", reward, FLOAT, (width, height))
    costs = checked("step_cost", step_cost, FLOAT, (2 * most + 1,))
    if not (width >= 1 and 1 <= height <= MAX_ROWS and most <= MAX_ROWS):
        raise ValueError(f"reward: expected 1 to {MAX_ROWS} rows, found {height}, with steps of {most}")
    path = np.empty(width, np.int32)
    if not _best_path(rewards, width, height, most, costs, address(path)):
        raise MemoryError
    return path


def find_surfaces(grid: ScanGrid, search: SurfaceSearch) -> FoundSurfaces:
    """Find ILM and RPE."""
    count = grid.shape[0]
    grid.check(search.deep + max(search.deep, 4 * search.band))
    rows, visible, tissue_grey = np.empty((2, 2, count)), np.empty((2, count), np.bool_), np.empty(1)
    outputs = (address(array) for array in (rows, visible, tissue_grey))
    if not _find_surfaces(grid.native, search.checked(), *outputs):
        raise MemoryError
    return FoundSurfaces(rows[0], rows[1], visible, float(tissue_grey[0]))


def remove_specks(visible: Mask, columns: int) -> Mask:
    """Return a mask, (n,), without runs of less than so many columns; half is enough at its border."""
    count = np.size(visible)
    checked("visible", visible, BOOL, (count,))
    out = visible.copy()
    _remove_specks(address(out), count, index(columns))
    return out
