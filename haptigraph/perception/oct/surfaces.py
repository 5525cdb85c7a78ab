"""ILM and RPE in one B-scan.

Turns an image (px) into the sub-pixel row of each surface in columns a few pixels apart, and where it is
visible. The ILM is the best path along the first steps from dark to bright, the RPE the best path along the
upper edge of a bright band below it. Where light is blocked, no surface is visible.
"""

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.imaging import FloatImage, Floats, Mask, peak_offset
from haptigraph.messages import Image
from haptigraph.perception.oct.shortest_path import best_path

__all__ = ["Surfaces", "find_surfaces", "without_specks"]

COLUMNS, ROWS = 72, 170  # largest size of the downsampled image
EDGE_MM = 0.02  # averaged on either side of a step
DEEP_MM = 0.12  # extent of bright tissue below the ILM
THINNEST_MM, THICKEST_MM = 0.1, 0.55  # from ILM to RPE
BAND_MM = 0.045  # thickness of the RPE's bright band
MAX_STEP_ROWS = 4  # rows from one column to the next
STEP_GREY, RPE_STEP_GREY = 3.0, 8.0  # cost of a path for each
SATURATION_GREY = 45.0  # limits the reward of metal and floaters, which are brighter than tissue
MIN_CONTRAST_GREY = 14.0  # of tissue against what is above it
MIN_CONTRAST_SD, MIN_RISE_SHARE = 3.0, 0.4  # in SDs of the noise; relative to the typical contrast
MIN_COLUMNS = 6
BODY_SHARE = 0.25
HALF = 0.5  # rows are counted at edges between pixels
NEIGHBOURS = 0.954  # median absolute difference of two standard normal variables
NEAR_ROWS = 1
SMOOTH, RPE_SMOOTH = (np.hanning(n)[1:-1] / np.hanning(n).sum() for n in (7, 13))  # the RPE is straighter


class Surfaces(NamedTuple):
    """Both surfaces, by column; rows are undefined where a surface is not visible."""

    x_px: Floats
    """Positions of the columns, (n,)."""
    ilm_px: Floats
    ilm_visible: Mask
    rpe_px: Floats
    rpe_visible: Mask
    dark_grey: float
    """Grey value without backscatter."""
    sd_grey: float
    """Standard deviation of a single such pixel's noise."""
    tissue_grey: float
    """Contrast of visible tissue against it."""


def find_surfaces(image: Image, axial_mm_per_px: float) -> Surfaces:
    """Find both surfaces.

    Args:
        image: (h, w) grey.
        axial_mm_per_px: Its axial scale.
    """
    height, width = image.shape
    across, down = max(1, round(width / COLUMNS)), max(1, round(height / ROWS))
    size = width // across, height // down
    cut = image[: size[1] * down, : size[0] * across]
    grey = cv2.resize(cut, size, interpolation=cv2.INTER_AREA).T.astype(np.float32)  # one row a column
    columns = _Columns(np.ascontiguousarray(grey), down * axial_mm_per_px)
    ilm = columns.find_ilm()
    visible = columns.is_tissue(ilm)
    rpe, rpe_visible = columns.find_rpe(ilm, visible)
    return Surfaces(
        np.arange(size[0]) * across + (across - 1) / 2,
        ilm * down - HALF,
        visible,
        rpe * down - HALF,
        rpe_visible & visible,
        columns.dark_grey,
        _noise(image),
        columns.tissue_grey,
    )


class _Columns:
    """The columns of a downsampled image.

    Args:
        grey: (w, h): one row of the array is one column of the image.
        mm_per_row: Axial scale.
    """

    def __init__(self, grey: FloatImage, mm_per_row: float) -> None:
        self._grey, self._mm_per_row = grey, mm_per_row
        self._numbers = np.arange(len(grey))
        self.dark_grey, lowest = _quantiles(grey[::3, ::3], 0.25, 0.04)
        self._sd_grey = max(self.dark_grey - lowest, 1.0)
        self.tissue_grey = 0.0

    def find_ilm(self) -> Floats:
        """Return the row of the ILM in each column, sub-pixel, (w,)."""
        edge, deep = self._rows(EDGE_MM), self._rows(DEEP_MM)
        means = _Means(_widened(self._grey, deep), deep)
        step = means(0, edge) - means(-edge, 0)
        half = deep // 2  # metal is bright too, but thin
        body = np.minimum(means(0, half), means(half, deep)) - self.dark_grey
        self._rise = body - np.maximum(means(-deep, 0) - self.dark_grey, 0)
        reward = _saturating(step) + _saturating(self._rise) + BODY_SHARE * body  # haze has no body
        path = best_path(np.asarray(reward, np.float32), _cost(STEP_GREY))
        return _refined(step, path, SMOOTH)

    def is_tissue(self, ilm: Floats) -> Mask:
        """Return the columns with tissue below the ILM's path, (w,)."""
        rows = np.clip(np.rint(ilm).astype(np.intp), 0, self._grey.shape[1] - 1)
        rise = self._rise[self._numbers, rows]
        (typical,) = _quantiles(rise, 0.9)
        noise_grey = self._sd_grey / self._rows(DEEP_MM) ** 0.5
        min_grey = max(MIN_CONTRAST_GREY, MIN_CONTRAST_SD * noise_grey, MIN_RISE_SHARE * typical)
        visible = without_specks(rise >= min_grey)
        self.tissue_grey = _quantiles(rise[visible], 0.5)[0] if visible.any() else 0.0
        return visible

    def find_rpe(self, ilm: Floats, visible: Mask) -> tuple[Floats, Mask]:
        """Return the row of the RPE in each column, sub-pixel, and where it is visible, (w,) each."""
        band, edge, most = self._rows(BAND_MM), self._rows(EDGE_MM), self._grey.shape[1]
        thin, thick = self._rows(THINNEST_MM), self._rows(THICKEST_MM)
        first = np.rint(ilm).astype(np.intp) + thin
        flat = first[:, None] + np.arange(-band, thick - thin + 4 * band)
        means = _Means(self._grey[self._numbers[:, None], np.clip(flat, 0, most - 1)], band, 4 * band)
        step, body = means(0, edge) - means(-edge, 0), means(0, band)
        rise, fall = body - means(-band, 0), body - means(2 * band, 4 * band)
        reward = _saturating(step) + _saturating(rise) + 0.5 * _saturating(fall)
        reward[~visible] = 0
        path = best_path(reward, _cost(RPE_STEP_GREY))
        wide, rise, fall = rise, rise[self._numbers, path], fall[self._numbers, path]
        min_grey = max(0.1 * self.tissue_grey, 2 * self._sd_grey / band**0.5)
        is_band = (rise > min_grey) & (fall > min_grey) & (first + path < most - 2 * band)
        return _refined(wide, path, RPE_SMOOTH) + first, without_specks(visible & is_band)

    def _rows(self, length_mm: float) -> int:
        return max(2, round(length_mm / self._mm_per_row))


class _Means:
    """Means over rows relative to every edge between rows.

    Args:
        grey: (w, above + h + below).
        above: Number of padding rows at the top.
        below: Number of padding rows at the bottom; None: as many.
    """

    def __init__(self, grey: FloatImage, above: int, below: int | None = None) -> None:
        self._above, self._height = above, grey.shape[1] - above - (above if below is None else below)
        self._sums = np.zeros((len(grey), grey.shape[1] + 1), np.float32)
        np.cumsum(grey, axis=1, out=self._sums[:, 1:])

    def __call__(self, start: int, end: int) -> FloatImage:
        """Return the mean of the rows in [start, end), counted from each edge, (w, h)."""
        low, high = self._above + start, self._above + end
        total = self._sums[:, high : high + self._height] - self._sums[:, low : low + self._height]
        total /= np.float32(end - start)
        return total


def _widened(grey: FloatImage, rows: int) -> FloatImage:
    """Pad columns by repeating their first and last pixel."""
    ends = (np.repeat(grey[:, :1], rows, axis=1), grey, np.repeat(grey[:, -1:], rows, axis=1))
    return np.concatenate(ends, axis=1)


def _noise(image: Image) -> float:
    """Estimate the standard deviation of a background pixel from the differences of neighbours."""
    some = image[::16, :-1:8].astype(np.int16) - image[::16, 1::8]
    return max(_quantiles(np.abs(some), 0.5)[0] / NEIGHBOURS, 1.0)


def _quantiles(values: NDArray[Any], *shares: float) -> list[float]:
    """Return quantiles to the nearest value, faster than NumPy's."""
    ordered = np.sort(values, axis=None)
    return [float(ordered[int(share * (len(ordered) - 1))]) for share in shares]


def _cost(grey: float) -> FloatImage:
    return (grey * np.arange(-MAX_STEP_ROWS, MAX_STEP_ROWS + 1) ** 2).astype(np.float32)


def _saturating(grey: FloatImage) -> FloatImage:
    """Compress large differences."""
    less = np.abs(grey)
    less /= np.float32(SATURATION_GREY)
    less += 1
    return np.asarray(np.divide(grey, less, out=less), np.float32)


def _refined(step: FloatImage, path: NDArray[np.intp], smooth: Floats) -> Floats:
    """Return the row of the steepest step near a path, sub-pixel, smoothed along it."""
    columns, reach = np.arange(len(path)), NEAR_ROWS + 1
    middle = np.clip(path, reach, step.shape[1] - 1 - reach)
    near = step[columns[:, None], middle[:, None] + np.arange(-reach, reach + 1)].astype(np.float64)
    best = near[:, 1:-1].argmax(axis=1) + 1
    top = peak_offset(near[columns, best - 1], near[columns, best], near[columns, best + 1])
    fine, beyond = middle + (best - reach) + top, len(smooth) // 2
    padded = np.concatenate((np.full(beyond, fine[0]), fine, np.full(beyond, fine[-1])))
    return np.convolve(padded, smooth, "valid")


def without_specks(visible: Mask) -> Mask:
    """Remove short runs of columns."""
    kernel = np.ones((1, MIN_COLUMNS), np.uint8)
    return np.asarray(cv2.morphologyEx(visible.astype(np.uint8)[None], cv2.MORPH_OPEN, kernel)[0] > 0)
