"""Turn the tip's detections in the images of a run into movements: evenly resampled and low-pass filtered.

All measures of a movement are taken at one rate, so that they do not depend on that of the images.
"""

from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

from haptigraph.analysis.metrics.data_quality import LONG_GAP_NS
from haptigraph.analysis.metrics.motion import SMOOTH_HZ, band_power, low_passed

__all__ = ["MOVEMENT_HZ", "RATE_TOLERANCE", "Detection", "Movement", "movements_of", "tremor_power"]

Floats = NDArray[np.float64]
MAX_TREMOR_GAP_NS = 100_000_000
"""Longer gaps are left out of the tremor's power: an interpolated tip does not tremble."""
MOVEMENT_HZ = 60.0
"""Rate at which movements are resampled."""
MIN_IMAGES_PER_S = 2 * SMOOTH_HZ
"""Of a movement: images that are rarer cannot show what the low-pass filter lets through."""
RATE_TOLERANCE = 0.99
"""Of a rate that must be reached, for cameras and clocks that are a little slow."""
MIN_SAMPLES = 4
"""Of a movement: a cubic spline needs as many."""
MIN_INTERVAL_S = 1e-3


class Detection(Struct, frozen=True):
    """One image with a visible tip; a measure that the scene graph lacks is NaN."""

    stamp_ns: int
    tip_mm: tuple[float, float]
    theta_deg: float
    retina_mm: float
    is_near: bool


class Movement(Struct, frozen=True):
    """A movement with the tip visible, sampled at `MOVEMENT_HZ` and low-pass filtered."""

    images_per_s: float
    """With the tip visible; the images that the samples are interpolated from."""
    time_s: Floats
    tip_mm: Floats
    theta_deg: Floats
    retina_mm: Floats
    is_near: NDArray[np.bool_]


def movements_of(detections: Sequence[Detection]) -> list[Movement]:
    """Return the movements between long gaps, except those with fewer than 10 images/s or 4 images."""
    movements = (_movement(piece) for piece in _pieces(detections, LONG_GAP_NS))
    return [movement for movement in movements if movement is not None]


def tremor_power(detections: Sequence[Detection]) -> float | None:
    """Return the mean `band_power` of the stretches between gaps, weighted by their numbers of images.

    Within a stretch, images are resampled at their own mean rate, so that samples hardly move in time: with
    intervals that vary by 10 %, a tremor's power is at most 5 % too low.
    """
    powers = []
    for piece in _pieces(detections, MAX_TREMOR_GAP_NS):
        if len(piece) < MIN_SAMPLES:
            continue
        time_s, tip_mm = _time_s(piece), np.array([each.tip_mm for each in piece])
        place = _places(time_s)
        rate_hz = float(place[-1] / (time_s[-1] - time_s[0]))
        even_s = time_s[0] + np.arange(place[-1] + 1) / rate_hz
        power = band_power(_resampled(time_s, tip_mm, even_s), rate_hz)
        if power is not None:
            powers.append((power, len(piece)))
    count = sum(count for _, count in powers)
    return sum(power * count for power, count in powers) / count if powers else None


def _pieces(detections: Sequence[Detection], max_gap_ns: int) -> list[Sequence[Detection]]:
    stamps_ns = np.array([each.stamp_ns for each in detections], np.int64)
    cuts = (np.flatnonzero(np.diff(stamps_ns) > max_gap_ns) + 1).tolist()
    return [detections[start:end] for start, end in zip([0, *cuts], [*cuts, len(detections)], strict=True)]


def _movement(piece: Sequence[Detection]) -> Movement | None:
    if len(piece) < MIN_SAMPLES:
        return None
    time_s = _time_s(piece)
    images_per_s = float((len(piece) - 1) / (time_s[-1] - time_s[0]))
    if images_per_s < RATE_TOLERANCE * MIN_IMAGES_PER_S:
        return None
    even_s = time_s[0] + np.arange(int((time_s[-1] - time_s[0]) * MOVEMENT_HZ + 1e-6) + 1) / MOVEMENT_HZ
    columns = np.array([(*each.tip_mm, each.theta_deg, each.retina_mm) for each in piece])
    smooth = np.full((len(even_s), columns.shape[1]), np.nan)
    is_known = np.isfinite(columns).all(axis=0)
    smooth[:, is_known] = low_passed(_resampled(time_s, columns[:, is_known], even_s), MOVEMENT_HZ)
    near = np.interp(even_s, time_s, [float(each.is_near) for each in piece])
    return Movement(images_per_s, even_s, smooth[:, :2], smooth[:, 2], smooth[:, 3], near > 0.5)


def _time_s(piece: Sequence[Detection]) -> Floats:
    return np.array([each.stamp_ns for each in piece]) / 1e9


def _places(time_s: Floats) -> NDArray[np.int_]:
    """Return the number of each image as if none were missing, by the median interval."""
    intervals_s = np.diff(time_s)
    usual_s = max(float(np.median(intervals_s)), MIN_INTERVAL_S)
    return np.concatenate([[0], np.cumsum(np.rint(intervals_s / usual_s).astype(int).clip(1))])


def _resampled(time_s: Floats, columns: Floats, even_s: Floats) -> Floats:
    """Interpolate (n, k) columns by cubic splines, in which straight lines replace missing images."""
    place = _places(time_s)
    every = np.arange(place[-1] + 1)
    filled = np.column_stack([np.interp(every, place, column) for column in (time_s, *columns.T)])
    values: Floats = make_interp_spline(filled[:, 0], filled[:, 1:], k=3)(even_s)
    return values
