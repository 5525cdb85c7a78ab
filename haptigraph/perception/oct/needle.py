"""The needle in a B-scan, selected among ridges, and its tip.

Turns ridges and surfaces (px) into one needle. Metal blocks the light: no tissue is visible below the shaft,
from the tip to the image's border on the shaft's side. A ghost casts no shadow, so a ridge with tissue below
it is rejected. The tip is at the edge of the shadow; a bright spot there gives its lower end. Inside tissue
there is no such spot, and the tip is less certain.
"""

import math
from typing import NamedTuple

import numpy as np

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats, Mask
from haptigraph.messages import Image
from haptigraph.perception.oct.ridge import Ridge
from haptigraph.perception.oct.surfaces import Surfaces

__all__ = ["Candidate", "Needle", "find_needle", "needle_candidates", "row_at", "without_ridge_columns"]

MIN_CONTRAST_GREY = 22.0  # of a ridge against its sides
MIN_LENGTH_PX, MAX_GAP_PX, MAX_START_PX = 24, 12, 60  # a ghost and its needle meet at the border
MIN_RIDGE_SHARE = 0.6  # of a candidate's length
SHADOW_MARGIN_PX = 14.0  # width of the shadow's soft edge beside tip and shaft
MAX_TISSUE_SHARE = 0.25  # of visible tissue in a shadow
SLOPE_COLUMNS, MAX_EXTRAPOLATION_PX = 6, 20.0  # for extrapolating a surface: columns used, rows at most
EDGE_LEVEL = 0.62  # between dark and bright, in decibels, where half of the light passes each way
WINDOW_PX = 48  # on either side of the shadow's edge
RPE_ROWS_PX, ILM_ROWS_PX = (-8, 18), (4, 34)
SPOT_ABOVE_PX, SPOT_BELOW_PX, SPOT_HALF_PX = 14, 26, 2
MIN_INSIDE_PX = 8.0  # with tissue above the shaft, the shadow starts further along at the RPE than at the ILM
ON_RIDGE_PX = 25.0
MIN_RUN_PX, RISE_SHARE = 8, 0.8
SMOOTH = np.full(5, 0.2)
MAX_EDGE_DISTANCE_PX = 200.0  # from the end of the continuous line to the visible tissue below it
BEVEL_PX = 64.0  # largest distance of the tip beyond the end of the continuous line
VISIBLE_TIP_SD_PX, EDGE_SD_PX, RIDGE_END_SD_PX = 1.5, 2.5, 4.0


class Needle(NamedTuple):
    """One needle."""

    ridge: Ridge
    tip_px: Vec
    is_inside: bool
    """Whether the tip is below the ILM."""
    sd_px: Vec
    """Lateral and axial standard deviation of the tip."""
    confidence: float
    """Share of the continuous line that is a ridge."""


class Candidate(NamedTuple):
    """The continuous part of a ridge that may be a needle's shaft."""

    ridge: Ridge
    end_px: int
    share: float

    @property
    def side(self) -> float:
        """1 if the needle comes from the left, else -1."""
        return math.copysign(1.0, self.ridge.along_px[0])


def find_needle(image: Image, candidates: list[Candidate], surfaces: Surfaces) -> Needle | None:
    """Return the needle; None if there is none.

    Args:
        image: (h, w) grey.
        candidates: Possible shafts.
        surfaces: ILM and RPE.
    """
    candidates = [candidate for candidate in candidates if _casts_shadow(candidate, surfaces)]
    if not candidates:
        return None
    return _with_tip(image, max(candidates, key=_evidence), surfaces)


def needle_candidates(ridges: list[Ridge], surfaces: Surfaces) -> list[Candidate]:
    """Return the ridges that may be shafts, up to their first gap."""
    return [candidate for ridge in ridges if (candidate := _candidate(ridge, surfaces)) is not None]


def without_ridge_columns(surfaces: Surfaces, candidates: list[Candidate]) -> Surfaces:
    """Remove the columns in which a thick ridge was mistaken for tissue."""
    on_ridge = np.zeros(len(surfaces.x_px), bool)
    for candidate in candidates:
        (x, y), (dx, dy) = candidate.ridge.start_px, candidate.ridge.along_px
        distance_px = (surfaces.x_px - x) / (dx or 1e-9)
        off_px = surfaces.ilm_px - (y + distance_px * dy)
        on_ridge |= (distance_px >= 0) & (distance_px <= candidate.end_px) & (np.abs(off_px) < ON_RIDGE_PX)
    ilm_visible, rpe_visible = surfaces.ilm_visible & ~on_ridge, surfaces.rpe_visible & ~on_ridge
    return surfaces._replace(ilm_visible=ilm_visible, rpe_visible=rpe_visible)


def _candidate(ridge: Ridge, surfaces: Surfaces) -> Candidate | None:
    """Return the part of a ridge that starts near the image's border; None if it is too short."""
    dark_grey = surfaces.dark_grey + max(2 * MIN_CONTRAST_GREY, 0.75 * surfaces.tissue_grey)
    is_ridge = (ridge.height_grey > MIN_CONTRAST_GREY) & (ridge.side_grey < dark_grey)
    distances = np.flatnonzero(is_ridge)
    if not len(distances) or distances[0] > MAX_START_PX:
        return None
    gaps = np.flatnonzero(np.diff(distances) > MAX_GAP_PX)
    gaps = gaps[distances[gaps + 1] > MAX_START_PX]
    end = int(distances[gaps[0]] if len(gaps) else distances[-1])
    share = float(is_ridge[distances[0] : end + 1].mean())
    return Candidate(ridge, end, share) if end >= MIN_LENGTH_PX and share >= MIN_RIDGE_SHARE else None


def _casts_shadow(candidate: Candidate, surfaces: Surfaces) -> bool:
    """Return whether no tissue is visible where a needle would shadow it."""
    ridge, side = candidate.ridge, candidate.side
    end_x = ridge.at_px(candidate.end_px)[0]
    slope = ridge.along_px[1] / ridge.along_px[0]
    shaft_y = ridge.start_px[1] + slope * (surfaces.x_px - ridge.start_px[0])
    is_below = surfaces.ilm_px > shaft_y + SHADOW_MARGIN_PX
    is_hidden = side * (end_x - surfaces.x_px) > SHADOW_MARGIN_PX
    tissue = int((is_hidden & is_below & surfaces.ilm_visible).sum())
    return tissue <= MAX_TISSUE_SHARE * min(int(is_hidden.sum()), int(surfaces.ilm_visible.sum()))


def _evidence(candidate: Candidate) -> float:
    return float(np.maximum(candidate.ridge.height_grey[: candidate.end_px], 0).sum())


def _with_tip(image: Image, candidate: Candidate, surfaces: Surfaces) -> Needle:
    ridge = candidate.ridge
    end_x = ridge.at_px(candidate.end_px)[0]
    edge_x = _shadow_edge(image, candidate, surfaces, surfaces.ilm_px, surfaces.ilm_visible, ILM_ROWS_PX)
    deep_x = _shadow_edge(image, candidate, surfaces, surfaces.rpe_px, surfaces.rpe_visible, RPE_ROWS_PX)
    if deep_x is not None and (edge_x is None or candidate.side * (deep_x - edge_x) > MIN_INSIDE_PX):
        on_line = ridge.at_px(ridge.distance_at_column(deep_x))
        if on_line[1] > row_at(surfaces.x_px, surfaces.ilm_px, surfaces.ilm_visible, deep_x):
            return _needle_at(candidate, deep_x, True)  # tissue is visible above the shaft, but not below
    if edge_x is None or not -SHADOW_MARGIN_PX < candidate.side * (edge_x - end_x) < BEVEL_PX:
        return _visible_end(candidate, surfaces)
    on_line = ridge.at_px(ridge.distance_at_column(edge_x))
    ilm_y = row_at(surfaces.x_px, surfaces.ilm_px, surfaces.ilm_visible, edge_x)
    if on_line[1] > ilm_y + SPOT_HALF_PX:
        return _needle_at(candidate, edge_x if deep_x is None else deep_x, True)
    min_grey = _typical_height(candidate) / 2
    spot_y = _spot_end(image, (edge_x, on_line[1]), ilm_y, surfaces.dark_grey, min_grey)
    if spot_y is None:
        return _needle_at(candidate, edge_x, False)
    return Needle(ridge, (edge_x, spot_y), False, (VISIBLE_TIP_SD_PX, VISIBLE_TIP_SD_PX), candidate.share)


def _needle_at(candidate: Candidate, x_px: float, is_inside: bool) -> Needle:
    """Return a needle whose tip is the intersection of its line with the shadow's edge."""
    slope = abs(candidate.ridge.along_px[1] / candidate.ridge.along_px[0])
    across = EDGE_SD_PX
    tip = candidate.ridge.at_px(candidate.ridge.distance_at_column(x_px))
    return Needle(candidate.ridge, tip, is_inside, (across, across * slope), candidate.share)


def _visible_end(candidate: Candidate, surfaces: Surfaces) -> Needle:
    """Return a needle whose tip is the end of its ridge, or of the bright spot beyond it."""
    height, end = candidate.ridge.height_grey, candidate.end_px
    half_grey = _typical_height(candidate) / 2
    beyond = np.flatnonzero(height[end : end + round(BEVEL_PX)] > half_grey)
    dark = candidate.ridge.side_grey[end : end + round(BEVEL_PX)] < surfaces.dark_grey + 2 * MIN_CONTRAST_GREY
    beyond = beyond[dark[beyond]]
    last = end + (int(beyond[-1]) if len(beyond) else 0)
    x, y = candidate.ridge.at_px(last)
    dx, dy = (RIDGE_END_SD_PX * abs(part) for part in candidate.ridge.along_px)
    return Needle(candidate.ridge, (x, y), False, (max(dx, 1.0), max(dy, 1.0)), candidate.share)


def _typical_height(candidate: Candidate) -> float:
    return float(np.median(candidate.ridge.height_grey[: candidate.end_px + 1]))


def _shadow_edge(
    image: Image, needle: Candidate, surfaces: Surfaces, row_px: Floats, seen: Mask, rows_px: tuple[int, int]
) -> float | None:
    """Return the column of the shadow's edge, sub-pixel; None if it is not near the line's end.

    Args:
        image: (h, w) grey.
        needle: The needle.
        surfaces: ILM and RPE.
        row_px: Rows of one of them in their columns.
        seen: Where this surface is visible.
        rows_px: Range of rows below the surface to evaluate.
    """
    end_x = needle.ridge.at_px(needle.end_px)[0]
    lit = np.flatnonzero(seen & (needle.side * (surfaces.x_px - end_x) > -SHADOW_MARGIN_PX))
    if not len(lit):
        return None
    first = int(lit[0] if needle.side > 0 else lit[-1])
    about_x, row = float(surfaces.x_px[first]), float(row_px[first])
    if needle.side * (about_x - end_x) > MAX_EDGE_DISTANCE_PX:
        return None
    ends = about_x - WINDOW_PX, about_x + WINDOW_PX, end_x - needle.side * SHADOW_MARGIN_PX
    left, right = max(round(min(ends)), 0), min(round(max(ends)), image.shape[1])
    if right - left < WINDOW_PX:
        return None
    columns = np.arange(left, right)
    behind = lit[:SLOPE_COLUMNS] if needle.side > 0 else lit[-SLOPE_COLUMNS:]
    slope = _slope(surfaces.x_px[behind], row_px[behind])
    course = row + np.clip(slope * (columns - about_x), -MAX_EXTRAPOLATION_PX, MAX_EXTRAPOLATION_PX)
    rows = np.rint(course).astype(np.intp) + np.arange(*rows_px)[:, None]
    rows = np.clip(rows, 0, image.shape[0] - 1)
    profile = image[rows, columns].mean(axis=0)
    if needle.side < 0:
        profile = profile[::-1]
    at = _first_rise(np.convolve(profile, SMOOTH, "valid"))
    if at is None:
        return None
    at += len(SMOOTH) // 2
    return left + at if needle.side > 0 else right - 1 - at


def _first_rise(profile: Floats) -> float | None:
    """Return where a dark profile first rises and stays bright, sub-pixel; None if it does not."""
    ordered = np.sort(profile)
    low, high = float(ordered[len(ordered) // 10]), float(ordered[len(ordered) * 4 // 5])
    if high - low < MIN_CONTRAST_GREY:
        return None
    sums = np.concatenate(([0.0], np.cumsum(profile)))
    ahead = (sums[MIN_RUN_PX:] - sums[:-MIN_RUN_PX]) / MIN_RUN_PX
    first = int(np.argmax(ahead > low + max(MIN_CONTRAST_GREY, RISE_SHARE * (high - low)) / 2))
    start, end = max(first - 2, 0), min(first + 3 * MIN_RUN_PX, len(profile))
    level = low + EDGE_LEVEL * (float(profile[first + MIN_RUN_PX // 2 : end].mean()) - low)
    above = np.flatnonzero(profile[start:end] >= level)
    if not len(above) or above[0] + start == 0:
        return None
    at = int(above[0]) + start
    return at - 1 + (level - float(profile[at - 1])) / max(float(profile[at] - profile[at - 1]), 1e-6)


def _spot_end(image: Image, at_px: Vec, ilm_y: float, dark_grey: float, min_grey: float) -> float | None:
    """Return the lower end of the bright spot at a point, as a sub-pixel row; None if there is none."""
    x, y = round(at_px[0]), round(at_px[1])
    top = max(y - SPOT_ABOVE_PX, 0)
    bottom = min(y + SPOT_BELOW_PX, image.shape[0], round(min(ilm_y, image.shape[0])))
    if bottom - top < 6:
        return None
    part = image[top:bottom, max(x - SPOT_HALF_PX, 0) : x + SPOT_HALF_PX + 1].mean(axis=1)
    profile = np.convolve(np.pad(part, 1, mode="edge"), np.full(3, 1 / 3), "valid")
    half_grey = (dark_grey + float(profile.max())) / 2
    bright = np.flatnonzero(profile > half_grey)
    if len(bright) < 3 or profile.max() < dark_grey + min_grey:
        return None
    last = int(bright[-1])
    if last + 1 >= len(profile):
        return None  # it merges with tissue
    fall = profile[last] - profile[last + 1]
    return float(top + last + (profile[last] - half_grey) / fall)


def _slope(x_px: Floats, row_px: Floats) -> float:
    """Return the slope of rows over columns by least squares; 0 for too few columns."""
    off = x_px - x_px.mean()
    return float(off @ row_px) / float(off @ off) if len(x_px) == SLOPE_COLUMNS else 0.0


def row_at(x_px: Floats, row_px: Floats, visible: Mask, at_x_px: float) -> float:
    """Return a surface's row in a column, extrapolated linearly beyond its visible part.

    Args:
        x_px: Columns, ascending, (n,).
        row_px: Rows of the surface in them, (n,).
        visible: Where they are valid, (n,).
        at_x_px: The column.
    """
    x, row = x_px[visible], row_px[visible]
    if not len(x):
        return math.inf
    if len(x) > SLOPE_COLUMNS and not x[0] <= at_x_px <= x[-1]:
        end = slice(0, SLOPE_COLUMNS) if at_x_px < x[0] else slice(-SLOPE_COLUMNS, None)
        return float(row[end].mean() + _slope(x[end], row[end]) * (at_x_px - x[end].mean()))
    return float(np.interp(at_x_px, x, row))
