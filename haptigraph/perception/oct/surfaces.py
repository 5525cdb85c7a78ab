"""ILM and RPE in one B-scan.

Turns an image (px) into the sub-pixel row of each surface in columns some 50 µm apart, and where it is
visible. The ILM is the best path along the first steps from dark to bright, the RPE the best path along the
upper edge of a bright band below it. Where light is blocked, no surface is visible.
"""

import math
from functools import lru_cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.imaging import Floats, Mask
from haptigraph.perception.native.bscan import SurfaceSearch, find_ilm, find_rpe, smooth_rows
from haptigraph.perception.oct.scan_image import ScanImage

__all__ = ["SurfaceConstants", "Surfaces", "find_surfaces", "without_specks"]

HALF = 0.5  # rows are counted at edges between pixels
MIN_COLUMNS = 6  # of `without_specks`


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
    down, rows = scan.cell_px[1], scan.grid.shape[1]
    search, dark_grey, darkest_grey = _search(scan), scan.levels.dark_grey, scan.levels.darkest_grey
    sd_grey = max(dark_grey - darkest_grey, 1.0)
    fine_ilm, rise_grey = find_ilm(scan.grid, search)
    min_grey = max(
        CONSTANTS.min_contrast_grey,
        CONSTANTS.min_contrast_sd * sd_grey / search.deep**0.5,
        CONSTANTS.min_rise_share * _quantile(rise_grey, 0.9),
    )
    column_mm = scan.column_px * scan.scale.lateral_mm
    run = max(2, round(CONSTANTS.min_width_mm / column_mm))
    is_tissue = _opened(rise_grey >= min_grey, run)
    tissue_grey = _quantile(rise_grey[is_tissue], 0.5) if is_tissue.any() else 0.0
    ilm, ilm_scatter = smooth_rows(fine_ilm, is_tissue, _window(CONSTANTS.smooth_mm / column_mm))
    border = max(3.0, CONSTANTS.border_mm / (down * scan.scale.axial_mm))
    fine_rpe, rise_grey, fall_grey = find_rpe(scan.grid, search, ilm, is_tissue)
    min_grey = max(CONSTANTS.min_band_share * tissue_grey, 2 * sd_grey / search.band**0.5)
    is_band = is_tissue & (np.minimum(rise_grey, fall_grey) > min_grey) & (fine_rpe < rows - 2 * search.band)
    rpe, rpe_scatter = smooth_rows(fine_rpe, is_band, _window(CONSTANTS.rpe_smooth_mm / column_mm))
    return Surfaces(
        np.arange(len(ilm), dtype=np.float64) * scan.column_px + (scan.column_px - 1) / 2,
        ilm * down - HALF,
        is_tissue & (ilm >= border),
        rpe * down - HALF,
        _opened(is_band, run),
        np.hypot(CONSTANTS.sd_mm[0] / scan.scale.axial_mm, CONSTANTS.sd_mm[1] * ilm_scatter * down),
        np.hypot(CONSTANTS.rpe_sd_mm[0] / scan.scale.axial_mm, CONSTANTS.rpe_sd_mm[1] * rpe_scatter * down),
        tissue_grey,
    )


def _search(scan: ScanImage) -> SurfaceSearch:
    """Return the limits in rows of the grid."""
    row_mm = scan.cell_px[1] * scan.scale.axial_mm
    column_mm = scan.column_px * scan.scale.lateral_mm

    def rows(length_mm: float) -> int:
        return max(2, round(length_mm / row_mm))

    cost, dark_grey = (row_mm / column_mm) ** 2, scan.levels.dark_grey
    return SurfaceSearch(
        edge=rows(CONSTANTS.edge_mm),
        deep=rows(CONSTANTS.deep_mm),
        thinnest=rows(CONSTANTS.thinnest_mm),
        thickest=max(rows(CONSTANTS.thickest_mm), rows(CONSTANTS.thinnest_mm) + 8),
        band=rows(CONSTANTS.band_mm),
        most=min(max(1, math.ceil(CONSTANTS.steepest * column_mm / row_mm)), 16),
        step_grey=CONSTANTS.slope_grey * cost,
        rpe_step_grey=CONSTANTS.rpe_slope_grey * cost,
        saturation_grey=CONSTANTS.saturation_grey,
        body_share=CONSTANTS.body_share,
        dark_grey=dark_grey,
        top_grey=dark_grey + CONSTANTS.top_share * (scan.levels.bright_grey - dark_grey),
    )


@lru_cache
def _window(half_columns: float) -> Floats:
    """Return a raised cosine."""
    reach = max(1, math.ceil(half_columns) - 1)
    return np.asarray(1 + np.cos(np.pi * np.arange(-reach, reach + 1) / max(half_columns, reach + 0.1)))


def _quantile(values: NDArray[Any], share: float) -> float:
    """Return a quantile to the nearest value, faster than NumPy's."""
    return float(np.sort(values)[int(share * (len(values) - 1))])


def without_specks(visible: Mask) -> Mask:
    """Remove short runs of columns."""
    return _opened(visible, MIN_COLUMNS)


def _opened(visible: Mask, columns: int) -> Mask:
    """Remove runs of less than so many columns."""
    kernel = np.ones((1, columns), np.uint8)
    return np.asarray(cv2.morphologyEx(visible.astype(np.uint8)[None], cv2.MORPH_OPEN, kernel)[0] > 0)
