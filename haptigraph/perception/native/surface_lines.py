"""The surfaces of a B-scan as lines that are reported (`bscan_lines.c`)."""

import ctypes
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats, Mask
from haptigraph.perception.native.arrays import BOOL, address, checked
from haptigraph.perception.native.bscan import DOUBLE, MAX_SCAN_PX
from haptigraph.perception.native.library import LIBRARY, pack

__all__ = ["LineLimits", "SurfaceColumns", "SurfaceLines", "surface_lines"]

_COLUMNS = LIBRARY.layout("Columns", ("p", "x_px row_px sd_px is_visible"), ("i", "count"))
_LINE_LIMITS = LIBRARY.layout(
    "LineLimits",
    ("d", "tip_px beyond_px alone_px parallel_px slope_sd center_px right_mm down_mm shares"),
    ("i", "slope_columns"),
)
_surface_lines = LIBRARY.function("surface_lines", "ppppppp", ctypes.c_int)


class SurfaceColumns(NamedTuple):
    """A surface, by column."""

    x_px: Floats
    """Ascending, (n,)."""
    row_px: Floats
    sd_px: Floats | None
    """Standard deviations; None where they are not estimated."""
    is_visible: Mask

    def checked(self, count: int) -> bytes:
        """Return the columns for C."""
        shape = (count,)
        x, row = checked("surface", self.x_px, DOUBLE, shape), checked("surface", self.row_px, DOUBLE, shape)
        sd = 0 if self.sd_px is None else checked("surface", self.sd_px, DOUBLE, shape)
        return pack(_COLUMNS, x, row, sd, checked("surface", self.is_visible, BOOL, shape), count)


class LineLimits(NamedTuple):
    """How surfaces are reported, as in bscan.h."""

    tip_px: float
    """Column of the tip; NaN if there is none."""
    beyond_px: float
    """Extension of a surface beyond the tip."""
    alone_px: float
    """From the tip to the nearest visible part of a surface; further away, it is not reported."""
    parallel_px: float
    """The same of a surface below another, to which it is parallel where it is not visible."""
    slope_sd: float
    """Standard deviation of the slope of what is not visible, in rows per column."""
    center_px: Vec
    right_mm: float
    """Millimetres per pixel to the right; negative in a mirrored image."""
    down_mm: float
    shares: Vec
    """Of the layers between ILM and RPE."""
    slope_columns: int
    """From which a surface is extrapolated."""

    def checked(self) -> bytes:
        """Return the limits for C."""
        if not 2 <= self.slope_columns <= MAX_SCAN_PX:
            raise ValueError(f"lines: expected 2 to {MAX_SCAN_PX} columns, found {self.slope_columns}")
        (x, y), (one, other) = self.center_px, self.shares
        return pack(
            _LINE_LIMITS, *self[:5], x, y, self.right_mm, self.down_mm, one, other, self.slope_columns
        )


class SurfaceLines(NamedTuple):
    """ILM, RPE and the layers between them [mm]; the layers have the columns of the RPE."""

    points_mm: NDArray[np.float64]
    """Vertices of ILM, RPE and both layers, all x before all y, (4, 2, n + 1)."""
    sds_mm: NDArray[np.float64]
    """Their standard deviations, (4, n + 1); NaN where they are not estimated."""
    ranges_mm: NDArray[np.float64]
    """Where ILM and RPE are not visible, from x to x, (2, n, 2)."""
    counts: list[int]
    """Vertices of ILM and RPE, and ranges of both."""


def surface_lines(ilm: SurfaceColumns, rpe: SurfaceColumns, limits: LineLimits) -> SurfaceLines:
    """Return surfaces from the first to the last visible column, extended below a tip."""
    count = np.size(ilm.x_px)
    points_mm, sds_mm = np.empty((4, 2, count + 1)), np.empty((4, count + 1))
    ranges_mm, counts = np.empty((2, count, 2)), np.empty(4, np.int32)
    outputs = (address(array) for array in (points_mm, sds_mm, ranges_mm, counts))
    if not _surface_lines(ilm.checked(count), rpe.checked(count), limits.checked(), *outputs):
        raise MemoryError
    return SurfaceLines(points_mm, sds_mm, ranges_mm, counts.tolist())
