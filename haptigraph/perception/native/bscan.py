"""Passes over a B-scan: downsampling, means of columns, surfaces (`bscan_cells.c`, `bscan_surfaces.c`)."""

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
    "GridLevels",
    "ScanGrid",
    "SurfaceSearch",
    "best_path",
    "column_means",
    "find_ilm",
    "find_rpe",
    "smooth_rows",
    "sum_cells",
]

MAX_CELL_PX, MAX_STEP_ROWS, MAX_SCAN_PX, MAX_CELLS, MAX_SUM_PX = map(
    LIBRARY.constant,
    ("MAX_CELL_PX", "MAX_STEP_ROWS", "MAX_SCAN_PX", "MAX_CELLS", "MAX_SUM_PX"),
)
MIN_CELLS, MAX_ROWS = 8, 10_000
DOUBLE = np.dtype(np.float64)

_GRID = LIBRARY.layout("Grid", ("p", "cells"), ("i", "rows columns group pixels"))
_SURFACE_SEARCH = LIBRARY.layout(
    "SurfaceSearch",
    ("i", "edge deep thinnest thickest band most"),
    ("d", "step_grey rpe_step_grey saturation_grey body_share dark_grey top_grey"),
)
_sum_cells = LIBRARY.function("sum_cells", "piiiiipp")
_cell_levels = LIBRARY.function("cell_levels", "pp")
_column_means = LIBRARY.function("column_means", "piiiippp")
_best_path = LIBRARY.function("best_path", "piiipp", ctypes.c_int)
_find_ilm = LIBRARY.function("find_ilm", "pppp", ctypes.c_int)
_find_rpe = LIBRARY.function("find_rpe", "ppppppp", ctypes.c_int)
_smooth_rows = LIBRARY.function("smooth_rows", "ppipippp")


class SurfaceSearch(NamedTuple):
    """Limits of the search for both surfaces, as in bscan.h; lengths in rows of the grid."""

    edge: int
    deep: int
    thinnest: int
    thickest: int
    band: int
    most: int
    step_grey: float
    rpe_step_grey: float
    saturation_grey: float
    body_share: float
    dark_grey: float
    top_grey: float

    def checked(self) -> bytes:
        """Return the limits for C."""
        whole = self.edge, self.deep // 2, self.thinnest, self.band, self.most
        valid = min(whole) > 0 and self.thickest >= self.thinnest + MIN_CELLS
        valid = valid and self.most <= MAX_STEP_ROWS
        if (
            not valid
            or max(*whole, self.deep, self.thickest) > MAX_ROWS
            or not 0 <= self.dark_grey <= self.top_grey <= 256
        ):
            raise ValueError(f"surfaces: expected lengths of 1 to {MAX_ROWS} rows, grey to 255; found {self}")
        return pack(_SURFACE_SEARCH, *self)


class GridLevels(NamedTuple):
    """Grey levels of a downsampled image."""

    dark_grey: float
    """Without backscatter."""
    darkest_grey: float
    difference_grey: float
    """Median absolute difference of neighbouring cells."""
    bright_grey: float
    """Of tissue, if there is some."""


class ScanGrid(Struct, frozen=True, eq=False):
    """A downsampled B-scan."""

    cells: NDArray[np.int32]
    """Sum of the grey of each cell, (rows, columns)."""
    group: int
    """Cells side by side that make one column of the surfaces."""
    pixels: int
    """Of a cell."""
    native: Any = None
    """The same for C; always made anew from the rest."""

    def __post_init__(self) -> None:
        rows, columns = np.shape(self.cells)
        if not (rows >= MIN_CELLS and self.group >= 1 and MIN_CELLS * self.group <= columns):
            raise ValueError(f"grid: expected at least {MIN_CELLS} rows and columns, found {rows}, {columns}")
        if not 1 <= self.pixels <= MAX_CELL_PX or max(rows, columns) > MAX_CELLS:
            limits = f"at most {MAX_CELLS} cells of at most {MAX_CELL_PX} pixels"
            raise ValueError(f"grid: expected {limits}, found {rows} x {columns} of {self.pixels}")
        cells = checked("cells", self.cells, INT, (rows, columns))
        force_setattr(self, "native", pack(_GRID, cells, rows, columns, self.group, self.pixels))

    @property
    def shape(self) -> tuple[int, int]:
        """Columns of the surfaces, and rows."""
        return self.cells.shape[1] // self.group, self.cells.shape[0]

    def check(self, padding: int) -> None:
        """Check that the sums of a column, with rows beyond the image, fit C's integers."""
        if (self.cells.shape[0] + padding + 1) * self.pixels * self.group > MAX_SUM_PX:
            raise ValueError(f"grid: expected columns of at most {MAX_SUM_PX} pixels")

    def levels(self) -> GridLevels:
        """Return the grey levels of the image."""
        out = np.empty(4)
        _cell_levels(self.native, address(out))
        return GridLevels(*out.tolist())


def sum_cells(image: Image, across: int, down: int) -> NDArray[np.int32]:
    """Return the sum of the grey of cells of `across` x `down` pixels, (rows, columns).

    Args:
        image: (h, w) grey.
        across: Columns of a cell.
        down: Rows of a cell.
    """
    height, width = np.shape(image)
    pixels = checked("image", image, BYTE, (height, width))
    if not (1 <= across <= width and 1 <= down <= height and across * down <= MAX_CELL_PX):
        raise ValueError(f"cells: expected at most {MAX_CELL_PX} pixels, found {across} x {down}")
    rows, columns = height // down, width // across
    sums, cells = np.empty(width, np.uint16), np.empty((rows, columns), np.int32)
    _sum_cells(pixels, width, across, down, rows, columns, address(sums), address(cells))
    return cells


def column_means(
    image: Image, first: int, top: NDArray[np.int32], bottom: NDArray[np.int32]
) -> NDArray[np.float32]:
    """Return the mean grey of rows from top to before bottom in columns from `first` on, (n,); NaN for none.

    Args:
        image: (h, w) grey.
        first: The first column.
        top: First row in each column, (n,).
        bottom: Row after the last, (n,).
    """
    height, width = np.shape(image)
    pixels = checked("image", image, BYTE, (height, width))
    count, first = len(top), index(first)
    if not (0 <= first <= first + count <= width) or height > MAX_SCAN_PX:
        raise ValueError(f"columns: expected some of {width}, found {count} from {first} on")
    rows = checked("top", top, INT, (count,)), checked("bottom", bottom, INT, (count,))
    means = np.empty(count, np.float32)
    _column_means(pixels, width, height, first, count, *rows, address(means))
    return means


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


def find_ilm(grid: ScanGrid, search: SurfaceSearch) -> tuple[Floats, NDArray[np.float32]]:
    """Return the row of the ILM in each column, and how much brighter it is below than above, (n,) each."""
    count = grid.shape[0]
    ilm, rise = np.empty(count), np.empty(count, np.float32)
    grid.check(2 * search.deep)
    if not _find_ilm(grid.native, search.checked(), address(ilm), address(rise)):
        raise MemoryError
    return ilm, rise


def find_rpe(
    grid: ScanGrid, search: SurfaceSearch, ilm: Floats, visible: Mask
) -> tuple[Floats, NDArray[np.float32], NDArray[np.float32]]:
    """Return the row of the RPE in each column, and how much brighter it is than above and below, (n,) each.

    Args:
        grid: The downsampled image.
        search: Limits.
        ilm: Row of the ILM in each column, (n,).
        visible: Columns with tissue, (n,).
    """
    count, rows = grid.shape
    surface, lit = checked("ilm", ilm, DOUBLE, (count,)), checked("visible", visible, BOOL, (count,))
    if not (ilm.min() >= 0 and ilm.max() <= rows):
        raise ValueError(f"ilm: expected rows from 0 to {rows}")
    grid.check(4 * search.band)
    rpe, rise, fall = np.empty(count), np.empty(count, np.float32), np.empty(count, np.float32)
    outputs = (address(array) for array in (rpe, rise, fall))
    if not _find_rpe(grid.native, search.checked(), surface, lit, *outputs):
        raise MemoryError
    return rpe, rise, fall


def smooth_rows(rows: Floats, visible: Mask, window: Floats) -> tuple[Floats, Floats]:
    """Smooth a surface over its visible columns; return its rows and the scatter about them, (n,) each.

    Args:
        rows: Row of the surface in each column, (n,).
        visible: Columns in which it is visible, (n,).
        window: Positive weights of neighbours, (k,), k odd.
    """
    count, reach = len(rows), len(window) // 2
    surface, lit = checked("rows", rows, DOUBLE, (count,)), checked("visible", visible, BOOL, (count,))
    weights = checked("window", window, DOUBLE, (2 * reach + 1,))
    misses, smooth, scatter = np.empty((3, count))
    outputs = (address(array) for array in (misses, smooth, scatter))
    _smooth_rows(surface, lit, count, weights, reach, *outputs)
    return smooth, scatter
