"""ILM and RPE in one B-scan.

Turns an image (px) into the sub-pixel row of each surface in columns some 50 µm apart, and where it is
visible. The ILM is the best path along the first steps from dark to bright, the RPE the best path along the
upper edge of a bright band below it. Where light is blocked, no surface is visible.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from haptigraph.imaging import Floats, Mask
from haptigraph.perception.native import bscan as native
from haptigraph.perception.oct.scan_image import ScanImage

__all__ = ["SLOPE_COLUMNS", "SurfaceConstants", "Surfaces", "find_surfaces", "row_at", "without_specks"]

HALF = 0.5  # rows are counted at edges between pixels
MIN_COLUMNS = 6  # of `without_specks`
SLOPE_COLUMNS = 6
"""From which a surface is extrapolated."""


class SurfaceConstants(NamedTuple):
    """Constants of the search for surfaces."""

    edge_mm: float = 0.02
    """Averaged on either side of a step."""
    deep_mm: float = 0.12
    """Extent of bright tissue below the ILM."""
    thinnest_mm: float = 0.1
    thickest_mm: float = 0.55
    """From ILM to RPE."""
    band_mm: float = 0.045
    """Thickness of the RPE's bright band."""
    steepest: float = 0.8
    """Slope of a surface, mm per mm."""
    slope_grey: float = 91.0
    """Cost of a path's slope, squared, per column of `COLUMN_MM`."""
    rpe_slope_grey: float = 243.0
    saturation_grey: float = 45.0
    """Limits the reward of metal and floaters, which are brighter than tissue."""
    top_share: float = 0.75
    """A column that begins brighter, from dark (0) to bright (1), begins with tissue."""
    body_share: float = 0.25
    """Reward for bright tissue; haze has none."""
    min_contrast_grey: float = 14.0
    """Of tissue against what is above it."""
    min_contrast_sd: float = 3.0
    min_rise_share: float = 0.4
    """In standard deviations of the noise; relative to the typical contrast."""
    min_width_mm: float = 0.3
    """A narrower visible part is a speck."""
    border_mm: float = 0.03
    """Nearer to the image's border, a surface is not visible."""
    smooth_mm: float = 0.165
    rpe_smooth_mm: float = 0.33
    """Half width of the window, a raised cosine; the RPE is straighter."""
    sd_mm: tuple[float, float] = (0.0017, 1.15)
    rpe_sd_mm: tuple[float, float] = (0.002, 0.8)
    """Standard deviation of a row: smallest, and in standard deviations of the rows in its window."""
    min_band_share: float = 0.1
    """Contrast of the RPE's band, relative to that of tissue."""
    min_band_sd: float = 2.0
    """The same, in standard deviations of the noise."""


CONSTANTS = SurfaceConstants()


class Surfaces(NamedTuple):
    """Both surfaces, by column; rows are undefined where a surface is not visible."""

    x_px: Floats
    """Positions of the columns, (n,)."""
    ilm_px: Floats
    ilm_visible: Mask
    rpe_px: Floats
    rpe_visible: Mask
    ilm_sd_px: Floats
    rpe_sd_px: Floats
    """Standard deviations of the rows."""
    tissue_grey: float
    """Contrast of visible tissue against what is dark."""


def find_surfaces(scan: ScanImage) -> Surfaces:
    """Find both surfaces."""
    found, down = native.find_surfaces(scan.grid, _search(scan)), scan.cell_px[1]
    ilm_px, rpe_px = found.rows * down - HALF
    ilm_sd_px, rpe_sd_px = found.sds * down
    x_px = np.arange(len(ilm_px), dtype=np.float64) * scan.column_px + (scan.column_px - 1) / 2
    ilm_visible, rpe_visible = found.visible
    return Surfaces(x_px, ilm_px, ilm_visible, rpe_px, rpe_visible, ilm_sd_px, rpe_sd_px, found.tissue_grey)


def _search(scan: ScanImage) -> native.SurfaceSearch:
    """Return the limits of the search in this B-scan."""
    dark_grey, noise_grey = scan.levels.dark_grey, scan.levels.noise_grey
    limits = _limits(scan.cell_px[1] * scan.scale.axial_mm, scan.column_px * scan.scale.lateral_mm)
    return limits._replace(
        dark_grey=dark_grey,
        top_grey=dark_grey + CONSTANTS.top_share * (scan.levels.bright_grey - dark_grey),
        min_rise_grey=max(
            CONSTANTS.min_contrast_grey, CONSTANTS.min_contrast_sd * noise_grey / math.sqrt(limits.deep)
        ),
        min_band_grey=CONSTANTS.min_band_sd * noise_grey / math.sqrt(limits.band),
    )


@lru_cache
def _limits(row_mm: float, column_mm: float) -> native.SurfaceSearch:
    """Return the limits in rows of a grid, those of grey still 0."""

    def rows(length_mm: float) -> int:
        return max(2, round(length_mm / row_mm))

    cost = (row_mm / column_mm) ** 2
    return native.SurfaceSearch(
        edge=rows(CONSTANTS.edge_mm),
        deep=rows(CONSTANTS.deep_mm),
        thinnest=rows(CONSTANTS.thinnest_mm),
        thickest=max(rows(CONSTANTS.thickest_mm), rows(CONSTANTS.thinnest_mm) + 8),
        band=rows(CONSTANTS.band_mm),
        most=min(max(1, math.ceil(CONSTANTS.steepest * column_mm / row_mm)), 16),
        min_columns=max(2, round(CONSTANTS.min_width_mm / column_mm)),
        step_grey=CONSTANTS.slope_grey * cost,
        rpe_step_grey=CONSTANTS.rpe_slope_grey * cost,
        saturation_grey=CONSTANTS.saturation_grey,
        body_share=CONSTANTS.body_share,
        dark_grey=0.0,
        top_grey=0.0,
        min_rise_grey=0.0,
        min_rise_share=CONSTANTS.min_rise_share,
        min_band_grey=0.0,
        min_band_share=CONSTANTS.min_band_share,
        border_rows=max(3.0, CONSTANTS.border_mm / row_mm),
        ilm=_smoothing(CONSTANTS.smooth_mm / column_mm, CONSTANTS.sd_mm, row_mm),
        rpe=_smoothing(CONSTANTS.rpe_smooth_mm / column_mm, CONSTANTS.rpe_sd_mm, row_mm),
    )


def _smoothing(half_columns: float, sd_mm: tuple[float, float], row_mm: float) -> native.Smoothing:
    """Return the smoothing by a raised cosine."""
    reach = max(1, math.ceil(half_columns) - 1)
    window = 1 + np.cos(np.pi * np.arange(-reach, reach + 1) / max(half_columns, reach + 0.1))
    return native.Smoothing(window, sd_mm[0] / row_mm, sd_mm[1])


def without_specks(visible: Mask) -> Mask:
    """Remove short runs of columns."""
    return native.remove_specks(visible, MIN_COLUMNS)


def row_at(x_px: Floats, row_px: Floats, visible: Mask, at_x_px: float) -> float:
    """Return a surface's row in a column, extrapolated linearly beyond its visible part.

    Args:
        x_px: Columns, ascending, (n,).
        row_px: Rows of the surface in them, (n,).
        visible: Where they are valid, (n,).
        at_x_px: The column.
    """
    at = np.flatnonzero(visible)
    if not len(at):
        return math.inf
    if len(at) > SLOPE_COLUMNS and not x_px[at[0]] <= at_x_px <= x_px[at[-1]]:
        end = at[:SLOPE_COLUMNS] if at_x_px < x_px[at[0]] else at[-SLOPE_COLUMNS:]
        x, row = x_px[end].tolist(), row_px[end].tolist()
        x_mean, row_mean = sum(x) / SLOPE_COLUMNS, sum(row) / SLOPE_COLUMNS
        spread = sum((one - x_mean) ** 2 for one in x)
        slope = sum((one - x_mean) * (other - row_mean) for one, other in zip(x, row, strict=True)) / spread
        return float(row_mean + slope * (at_x_px - x_mean))
    return float(np.interp(at_x_px, x_px[at], row_px[at]))
