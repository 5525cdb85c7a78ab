"""ILM and RPE in a volume, as height maps.

Turns a volume into the height of each surface over slices and columns, where it is visible, and its standard
deviation (eye frame, mm). The ILM is the best path along the first steps from dark to bright, the RPE the
best path along the upper edge of a bright band below it, slice by slice. Then neighbouring slices must agree:
cells far from the mean of their neighbourhood are not visible. Where light is blocked, a surface is
interpolated, and its standard deviation grows with the distance from what is visible.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.imaging import FloatImage, Floats, Mask, peak_offset
from haptigraph.perception.native.volume_surfaces import best_paths, ilm_rewards, rpe_rewards
from haptigraph.perception.volume.cells import Cells

__all__ = ["HeightMap", "SurfaceMaps", "find_surface_maps"]

EDGE_MM = 0.02  # averaged on either side of a step
DEEP_MM = 0.12  # extent of bright tissue below the ILM
THINNEST_MM, THICKEST_MM = 0.1, 0.55  # from ILM to RPE
BAND_MM = 0.045  # thickness of the RPE's bright band
MAX_STEP_ROWS = 3  # rows from one column to the next
STEP_GREY, RPE_STEP_GREY = 4.0, 10.0  # cost of a path for each
MIN_CONTRAST_GREY, MIN_RISE_SHARE = 14.0, 0.4  # of tissue against what is above it; of the typical contrast
HALF = 0.5  # rows are counted at edges between voxels
RISE_MM = 0.002  # from where a surface begins to where it brightens most
OUTLIER_MM = 0.025  # from the median of the neighbourhood
NEAR_MM, WIDE_MM = 0.09, 0.5  # standard deviations of the windows that interpolate what is not visible
SMOOTH_SLICES, SMOOTH_CELLS = 0.6, 0.9  # standard deviations of the final smoothing
VISIBLE_SD_MM = {"ilm": 0.0025, "rpe": 0.0035}
HIDDEN_SLOPE = 0.05  # growth of an interpolated surface's standard deviation with the distance


class HeightMap(NamedTuple):
    """One surface over slices and cells, eye frame."""

    x_mm: Floats
    """Positions of the cells, ascending, (k,)."""
    z_mm: Floats
    """Positions of the slices, ascending, (n,)."""
    height_mm: Floats
    """(n, k), everywhere."""
    visible: Mask
    """Whether the surface is visible in a cell; otherwise its height is interpolated, (n, k)."""
    sd_mm: Floats
    """Standard deviation of the height, (n, k)."""

    def only_where(self, visible: Mask) -> "HeightMap":
        """Return the map with fewer visible cells."""
        size_mm = float(self.z_mm[1] - self.z_mm[0]), float(self.x_mm[1] - self.x_mm[0])
        least_mm = float(self.sd_mm.min())
        if not visible.any() or not math.isfinite(least_mm):
            return self._replace(visible=visible, sd_mm=np.full(visible.shape, np.inf))
        return self._replace(visible=visible, sd_mm=least_mm + HIDDEN_SLOPE * _distance_mm(visible, size_mm))

    def at(self, x_mm: Floats, z_mm: Floats, what: Floats | None = None) -> Floats:
        """Return the height, or another array of the map's shape, at points: bilinear, constant outside."""
        values = self.height_mm if what is None else what
        at_x = np.clip((x_mm - self.x_mm[0]) / (self.x_mm[1] - self.x_mm[0]), 0, len(self.x_mm) - 1.001)
        at_z = np.clip((z_mm - self.z_mm[0]) / (self.z_mm[1] - self.z_mm[0]), 0, len(self.z_mm) - 1.001)
        left, low = at_x.astype(np.intp), at_z.astype(np.intp)
        right_share, high_share = at_x - left, at_z - low
        lower = values[low, left] * (1 - right_share) + values[low, left + 1] * right_share
        upper = values[low + 1, left] * (1 - right_share) + values[low + 1, left + 1] * right_share
        return np.asarray(lower * (1 - high_share) + upper * high_share, np.float64)


class SurfaceMaps(NamedTuple):
    """Both surfaces."""

    ilm: HeightMap
    rpe: HeightMap
    tissue_grey: float
    """Contrast of visible tissue against the noise; 0 without tissue."""


def find_surface_maps(cells: Cells) -> SurfaceMaps:
    """Find both surfaces in a downsampled volume."""
    finder = _Finder(cells)
    ilm, visible = finder.find_ilm()
    ilm_map = finder.height_map("ilm", ilm, visible)
    rpe, rpe_visible = finder.find_rpe(finder.rows_of(ilm_map), ilm_map.visible)
    return SurfaceMaps(ilm_map, finder.height_map("rpe", rpe, rpe_visible), finder.tissue_grey)


class _Finder:
    """Find surfaces in one volume."""

    def __init__(self, cells: Cells) -> None:
        self._cells, self._grey = cells, cells.grey
        self._row_mm = cells.scale.axial_mm
        self.tissue_grey = 0.0

    def find_ilm(self) -> tuple[Floats, Mask]:
        """Return the row of the ILM in each cell, and where it is visible, (n, k) each."""
        edge, deep = self._rows(EDGE_MM), self._rows(DEEP_MM)
        reward, step, rise = ilm_rewards(self._grey, self._cells.dark_grey, edge, deep)
        path = best_paths(reward, _cost(STEP_GREY))
        contrast = _at(rise, path)
        typical = float(np.quantile(contrast, 0.9))
        visible = contrast >= max(MIN_CONTRAST_GREY, MIN_RISE_SHARE * typical)
        self.tissue_grey = float(np.median(contrast[visible])) if visible.any() else 0.0
        return _refined(step, path), visible

    def find_rpe(self, ilm: Floats, visible: Mask) -> tuple[Floats, Mask]:
        """Return the row of the RPE in each cell, and where it is visible, (n, k) each."""
        band, edge, rows = self._rows(BAND_MM), self._rows(EDGE_MM), len(self._grey)
        thin, thick = self._rows(THINNEST_MM), self._rows(THICKEST_MM)
        first = np.rint(ilm).astype(np.intp) + thin
        flat = first + np.arange(-band, thick - thin + 4 * band)[:, None, None]
        near = np.take_along_axis(self._grey, np.clip(flat, 0, rows - 1), axis=0)
        reward, smooth_rise, rise, fall = rpe_rewards(near, edge, band)
        reward[:, ~visible] = 0
        path = best_paths(reward, _cost(RPE_STEP_GREY))
        min_grey = max(0.1 * self.tissue_grey, 4.0)
        is_band = (
            (_at(rise, path) > min_grey) & (_at(fall, path) > min_grey) & (first + path < rows - 2 * band)
        )
        return _refined(smooth_rise, path) + first, visible & is_band

    def rows_of(self, surface: HeightMap) -> Floats:
        """Return a surface in downsampled rows, (n, k)."""
        return (self._cells.first_row_mm - surface.height_mm) / self._row_mm

    def height_map(self, name: str, row: Floats, visible: Mask) -> HeightMap:
        """Smooth a surface, remove outliers and interpolate where it is not visible."""
        height = self._cells.height_mm(row - HALF) + RISE_MM
        scale, x_mm = self._cells.scale, self._cells.x_mm
        z_mm = scale.z_mm
        opened = cv2.morphologyEx(visible.astype(np.uint8), cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
        visible = np.asarray(opened > 0)  # without specks
        if visible.sum() < 12:
            nothing = np.zeros_like(visible)
            return HeightMap(x_mm, z_mm, height, nothing, np.full(height.shape, np.inf))
        smooth = _trend(x_mm, z_mm, height, visible)
        rest = np.where(visible, height - smooth, 0.0)
        size = scale.slice_mm, scale.lateral_mm
        wide = _blurred(rest, visible, WIDE_MM / 4, size)
        visible &= np.abs(rest - wide) < 3 * OUTLIER_MM
        near = _blurred(rest, visible, NEAR_MM, size)
        visible &= np.abs(rest - near) < OUTLIER_MM
        filled = smooth + _filled(rest, visible, size)
        fine = smooth + np.where(visible, rest, filled - smooth)
        smoothed = cv2.GaussianBlur(
            fine, (0, 0), SMOOTH_CELLS, sigmaY=SMOOTH_SLICES, borderType=cv2.BORDER_REFLECT
        )
        away_mm = _distance_mm(visible, size)
        sd_mm = VISIBLE_SD_MM[name] + HIDDEN_SLOPE * away_mm
        return HeightMap(x_mm, z_mm, np.asarray(smoothed, np.float64), visible, sd_mm)

    def _rows(self, length_mm: float) -> int:
        return max(2, round(length_mm / self._row_mm))


def _cost(grey: float) -> FloatImage:
    return (grey * np.arange(-MAX_STEP_ROWS, MAX_STEP_ROWS + 1) ** 2).astype(np.float32)


def _at(values: FloatImage, path: NDArray[np.int32]) -> FloatImage:
    """Return values along a path, (n, k)."""
    return np.asarray(np.take_along_axis(values, path[None], axis=0)[0], np.float32)


def _refined(step: FloatImage, path: NDArray[np.int32]) -> Floats:
    """Return the row of the steepest step near a path, sub-voxel, (n, k)."""
    reach = 2
    middle = np.clip(path, reach, len(step) - 1 - reach)
    near = np.take_along_axis(step, middle[None] + np.arange(-reach, reach + 1)[:, None, None], axis=0)
    near = near.astype(np.float64)
    best = near[1:-1].argmax(axis=0) + 1
    before, at, after = (np.take_along_axis(near, (best + off)[None], axis=0)[0] for off in (-1, 0, 1))
    return np.asarray(middle + (best - reach) + peak_offset(before, at, after), np.float64)


def _trend(x_mm: Floats, z_mm: Floats, height: Floats, visible: Mask) -> Floats:
    """Return a robust quadratic fit, (n, k)."""
    z, x = np.meshgrid(z_mm, x_mm, indexing="ij")
    terms = np.stack([np.ones_like(x), x, z, x * x, x * z, z * z], axis=-1)
    weight = visible.astype(np.float64)
    fit = np.zeros_like(height)
    for _ in range(4):
        design = terms.reshape(-1, 6) * weight.reshape(-1, 1)
        solution = np.linalg.lstsq(design.T @ terms.reshape(-1, 6), design.T @ height.ravel(), rcond=None)[0]
        fit = terms @ solution
        weight = visible / (1 + ((height - fit) / 0.03) ** 2)
    return np.asarray(fit, np.float64)


def _blurred(values: Floats, visible: Mask, sigma_mm: float, size_mm: tuple[float, float]) -> Floats:
    """Return the local weighted mean of visible cells, (n, k)."""
    total, weight = _sums(values, visible, sigma_mm, size_mm)
    return np.asarray(total / np.maximum(weight, 1e-9), np.float64)


def _sums(
    values: Floats, visible: Mask, sigma_mm: float, size_mm: tuple[float, float]
) -> tuple[Floats, Floats]:
    """Return the local sums of visible values and of their weights, (n, k) each."""
    sigma_x, sigma_y = sigma_mm / size_mm[1], sigma_mm / size_mm[0]
    total, weight = (
        cv2.GaussianBlur(array, (0, 0), sigma_x, sigmaY=sigma_y, borderType=cv2.BORDER_CONSTANT)
        for array in (np.where(visible, values, 0.0), visible.astype(np.float64))
    )
    return np.asarray(total, np.float64), np.asarray(weight, np.float64)


def _filled(values: Floats, visible: Mask, size_mm: tuple[float, float]) -> Floats:
    """Interpolate what is not visible from near cells, or from cells further away where none is near."""
    near, near_weight = _sums(values, visible, NEAR_MM, size_mm)
    wide, wide_weight = _sums(values, visible, WIDE_MM, size_mm)
    share = np.clip(near_weight / 0.1, 0, 1)
    far = wide / np.maximum(wide_weight, 1e-6)
    return np.asarray(share * near / np.maximum(near_weight, 1e-6) + (1 - share) * far, np.float64)


def _distance_mm(visible: Mask, size_mm: tuple[float, float]) -> Floats:
    """Return the approximate distance of each cell from the nearest visible one, (n, k)."""
    away = np.where(visible, 0.0, np.inf)
    for axis, step_mm in ((1, size_mm[1]), (0, size_mm[0])):
        rows = np.moveaxis(away, axis, 0)
        for number in range(1, len(rows)):
            np.minimum(rows[number], rows[number - 1] + step_mm, out=rows[number])
        for number in range(len(rows) - 2, -1, -1):
            np.minimum(rows[number], rows[number + 1] + step_mm, out=rows[number])
    return away
