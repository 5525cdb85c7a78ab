"""Which ridge of a B-scan is the needle, and where its tip is.

Turns ridges and surfaces (px) into one needle. Metal lets no light through: below a needle, and on its side
of the tip up to the image's border, no tissue is seen. A ghost casts no shadow, so tissue below a ridge
refuses it. The tip is where the shadow begins; the bright spot there says how far it reaches down. In tissue
there is no such spot, and the tip is known less well. Knows no image before.
"""

import math
from typing import NamedTuple

import numpy as np

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats, Mask
from haptigraph.messages import Image
from haptigraph.perception.oct.ridge import Ridge
from haptigraph.perception.oct.surfaces import Surfaces

__all__ = ["Line", "Needle", "find_needle", "lines_of", "off_ridges", "row_at"]

LEAST_GREY = 22.0  # a ridge is so much brighter than its sides
LEAST_LENGTH_PX, LONGEST_GAP_PX, LONGEST_START_PX = 24, 12, 60  # a ghost and its needle meet at the border
LEAST_SHARE = 0.6  # of the way must be ridge
MARGIN_PX = 14.0  # beside the tip, where the shadow's edge is soft
TISSUE_IN_SHADOW = 0.25  # of the shadow, or of all tissue that is seen: more, and it is none
SLOPE_COLUMNS, STRAIGHT_PX = 6, 20.0  # tell how a surface goes on, and how far down or up at most
LIT_LEVEL = 0.62  # of the way from dark to bright: half of the light there and half back, in decibels
WINDOW_PX = 48  # about the shadow's edge
RPE_ROWS_PX, ILM_ROWS_PX = (-8, 18), (4, 34)
SPOT_ABOVE_PX, SPOT_BELOW_PX, SPOT_HALF_PX = 14, 26, 2
INSIDE_PX = 8.0  # the shadow at the RPE begins so much further: tissue lies above the shaft
ON_RIDGE_PX = 25.0
STAYS_PX, RISE_SHARE = 8, 0.8
SMOOTH = np.full(5, 0.2)
FURTHEST_PX = 200.0  # from the end of the continuous line to the tissue that is seen below it
BEVEL_PX = 64.0  # the tip lies at most so far beyond the end of the continuous line
SEEN_DEVIATION_PX, EDGE_DEVIATION_PX, END_DEVIATION_PX = 1.5, 2.5, 4.0


class Needle(NamedTuple):
    """One needle."""

    ridge: Ridge
    tip_px: Vec
    is_inside: bool
    """Whether the tip is below the ILM."""
    sd_px: Vec
    """Of the tip: across the image and down it."""
    confidence: float
    """Share of the way, up to where the line ends, that shows a ridge."""


class Line(NamedTuple):
    """The continuous part of a ridge."""

    ridge: Ridge
    end_px: int
    share: float

    @property
    def side(self) -> float:
        """1 if the needle comes from the left, else -1."""
        return math.copysign(1.0, self.ridge.along_px[0])


def find_needle(image: Image, lines: list[Line], surfaces: Surfaces) -> Needle | None:
    """Return the needle, if there is one.

    Args:
        image: (h, w) grey.
        lines: What may be shafts.
        surfaces: What else there is.
    """
    lines = [line for line in lines if _casts_shadow(line, surfaces)]
    if not lines:
        return None
    return _with_tip(image, max(lines, key=_evidence), surfaces)


def lines_of(ridges: list[Ridge], surfaces: Surfaces) -> list[Line]:
    """Return the ridges that may be shafts, as far as they go on without a gap."""
    return [line for ridge in ridges if (line := _line(ridge, surfaces)) is not None]


def off_ridges(surfaces: Surfaces, lines: list[Line]) -> Surfaces:
    """Return surfaces without the columns in which a thick ridge was taken for tissue."""
    on_ridge = np.zeros(len(surfaces.x_px), bool)
    for line in lines:
        (x, y), (dx, dy) = line.ridge.start_px, line.ridge.along_px
        way_px = (surfaces.x_px - x) / (dx or 1e-9)
        off_px = surfaces.ilm_px - (y + way_px * dy)
        on_ridge |= (way_px >= 0) & (way_px <= line.end_px) & (np.abs(off_px) < ON_RIDGE_PX)
    seen, rpe_seen = surfaces.ilm_seen & ~on_ridge, surfaces.rpe_seen & ~on_ridge
    return surfaces._replace(ilm_seen=seen, rpe_seen=rpe_seen)


def _line(ridge: Ridge, surfaces: Surfaces) -> Line | None:
    """Return the part of a ridge that begins at the image's border; None if there is too little."""
    dark_grey = surfaces.dark_grey + max(2 * LEAST_GREY, 0.75 * surfaces.tissue_grey)
    is_ridge = (ridge.height_grey > LEAST_GREY) & (ridge.side_grey < dark_grey)
    ways = np.flatnonzero(is_ridge)
    if not len(ways) or ways[0] > LONGEST_START_PX:
        return None
    gaps = np.flatnonzero(np.diff(ways) > LONGEST_GAP_PX)
    gaps = gaps[ways[gaps + 1] > LONGEST_START_PX]
    end = int(ways[gaps[0]] if len(gaps) else ways[-1])
    share = float(is_ridge[ways[0] : end + 1].mean())
    return Line(ridge, end, share) if end >= LEAST_LENGTH_PX and share >= LEAST_SHARE else None


def _casts_shadow(line: Line, surfaces: Surfaces) -> bool:
    """Tell whether no tissue is seen where a needle would hide it."""
    ridge, side = line.ridge, line.side
    end_x = ridge.at_px(line.end_px)[0]
    slope = ridge.along_px[1] / ridge.along_px[0]
    shaft_y = ridge.start_px[1] + slope * (surfaces.x_px - ridge.start_px[0])
    is_below = surfaces.ilm_px > shaft_y + MARGIN_PX
    hidden = side * (end_x - surfaces.x_px) > MARGIN_PX
    wrong = int((hidden & is_below & surfaces.ilm_seen).sum())
    return wrong <= TISSUE_IN_SHADOW * min(int(hidden.sum()), int(surfaces.ilm_seen.sum()))


def _evidence(line: Line) -> float:
    return float(np.maximum(line.ridge.height_grey[: line.end_px], 0).sum())


def _with_tip(image: Image, line: Line, surfaces: Surfaces) -> Needle:
    ridge = line.ridge
    end_x = ridge.at_px(line.end_px)[0]
    edge_x = _shadow_edge(image, line, surfaces, surfaces.ilm_px, surfaces.ilm_seen, ILM_ROWS_PX)
    deep_x = _shadow_edge(image, line, surfaces, surfaces.rpe_px, surfaces.rpe_seen, RPE_ROWS_PX)
    if deep_x is not None and (edge_x is None or line.side * (deep_x - edge_x) > INSIDE_PX):
        on_line = ridge.at_px(ridge.way_at_column(deep_x))
        if on_line[1] > row_at(surfaces.x_px, surfaces.ilm_px, surfaces.ilm_seen, deep_x):
            return _needle_at(line, deep_x, True)  # tissue above the shaft is seen, that below is not
    if edge_x is None or not -MARGIN_PX < line.side * (edge_x - end_x) < BEVEL_PX:
        return _seen_end(line, surfaces)
    on_line = ridge.at_px(ridge.way_at_column(edge_x))
    ilm_y = row_at(surfaces.x_px, surfaces.ilm_px, surfaces.ilm_seen, edge_x)
    if on_line[1] > ilm_y + SPOT_HALF_PX:
        return _needle_at(line, edge_x if deep_x is None else deep_x, True)
    least_grey = _usual_height(line) / 2
    spot_y = _spot_end(image, (edge_x, on_line[1]), ilm_y, surfaces.dark_grey, least_grey)
    if spot_y is None:
        return _needle_at(line, edge_x, False)
    return Needle(ridge, (edge_x, spot_y), False, (SEEN_DEVIATION_PX, SEEN_DEVIATION_PX), line.share)


def _needle_at(line: Line, x_px: float, is_inside: bool) -> Needle:
    """Return a needle whose tip is where its line meets the shadow's edge."""
    slope = abs(line.ridge.along_px[1] / line.ridge.along_px[0])
    across = EDGE_DEVIATION_PX
    tip = line.ridge.at_px(line.ridge.way_at_column(x_px))
    return Needle(line.ridge, tip, is_inside, (across, across * slope), line.share)


def _seen_end(line: Line, surfaces: Surfaces) -> Needle:
    """Return a needle whose tip is where its ridge, or the spot beyond it, ends."""
    height, end = line.ridge.height_grey, line.end_px
    half_grey = _usual_height(line) / 2
    beyond = np.flatnonzero(height[end : end + round(BEVEL_PX)] > half_grey)
    dark = line.ridge.side_grey[end : end + round(BEVEL_PX)] < surfaces.dark_grey + 2 * LEAST_GREY
    beyond = beyond[dark[beyond]]
    last = end + (int(beyond[-1]) if len(beyond) else 0)
    x, y = line.ridge.at_px(last)
    dx, dy = (END_DEVIATION_PX * abs(part) for part in line.ridge.along_px)
    return Needle(line.ridge, (x, y), False, (max(dx, 1.0), max(dy, 1.0)), line.share)


def _usual_height(line: Line) -> float:
    return float(np.median(line.ridge.height_grey[: line.end_px + 1]))


def _shadow_edge(
    image: Image, line: Line, surfaces: Surfaces, row_px: Floats, seen: Mask, rows_px: tuple[int, int]
) -> float | None:
    """Return the column in which tissue begins to be seen, sub-pixel; None if none is near the line's end.

    Args:
        image: (h, w) grey.
        line: The needle.
        surfaces: Say how bright tissue is.
        row_px: Rows of a surface by column of `surfaces`.
        seen: Where it was seen.
        rows_px: Rows below the surface that are looked at.
    """
    end_x = line.ridge.at_px(line.end_px)[0]
    lit = np.flatnonzero(seen & (line.side * (surfaces.x_px - end_x) > -MARGIN_PX))
    if not len(lit):
        return None
    first = int(lit[0] if line.side > 0 else lit[-1])
    about_x, row = float(surfaces.x_px[first]), float(row_px[first])
    if line.side * (about_x - end_x) > FURTHEST_PX:
        return None
    ends = about_x - WINDOW_PX, about_x + WINDOW_PX, end_x - line.side * MARGIN_PX
    left, right = max(round(min(ends)), 0), min(round(max(ends)), image.shape[1])
    if right - left < WINDOW_PX:
        return None
    columns = np.arange(left, right)
    behind = lit[:SLOPE_COLUMNS] if line.side > 0 else lit[-SLOPE_COLUMNS:]
    slope = _slope(surfaces.x_px[behind], row_px[behind])
    course = row + np.clip(slope * (columns - about_x), -STRAIGHT_PX, STRAIGHT_PX)
    rows = np.rint(course).astype(np.intp) + np.arange(*rows_px)[:, None]
    rows = np.clip(rows, 0, image.shape[0] - 1)
    profile = image[rows, columns].mean(axis=0)
    if line.side < 0:
        profile = profile[::-1]
    at = _rise(np.convolve(profile, SMOOTH, "valid"))
    if at is None:
        return None
    at += len(SMOOTH) // 2
    return left + at if line.side > 0 else right - 1 - at


def _rise(profile: Floats) -> float | None:
    """Return where a profile that begins dark first rises for good, sub-pixel; None if it does not."""
    ordered = np.sort(profile)
    low, high = float(ordered[len(ordered) // 10]), float(ordered[len(ordered) * 4 // 5])
    if high - low < LEAST_GREY:
        return None
    sums = np.concatenate(([0.0], np.cumsum(profile)))
    ahead = (sums[STAYS_PX:] - sums[:-STAYS_PX]) / STAYS_PX
    first = int(np.argmax(ahead > low + max(LEAST_GREY, RISE_SHARE * (high - low)) / 2))
    start, end = max(first - 2, 0), min(first + 3 * STAYS_PX, len(profile))
    level = low + LIT_LEVEL * (float(profile[first + STAYS_PX // 2 : end].mean()) - low)
    above = np.flatnonzero(profile[start:end] >= level)
    if not len(above) or above[0] + start == 0:
        return None
    at = int(above[0]) + start
    return at - 1 + (level - float(profile[at - 1])) / max(float(profile[at] - profile[at - 1]), 1e-6)


def _spot_end(image: Image, at_px: Vec, ilm_y: float, dark_grey: float, least_grey: float) -> float | None:
    """Return the row where the bright spot about a place ends downwards, sub-pixel; None if there is none."""
    x, y = round(at_px[0]), round(at_px[1])
    top = max(y - SPOT_ABOVE_PX, 0)
    bottom = min(y + SPOT_BELOW_PX, image.shape[0], round(min(ilm_y, image.shape[0])))
    if bottom - top < 6:
        return None
    part = image[top:bottom, max(x - SPOT_HALF_PX, 0) : x + SPOT_HALF_PX + 1].mean(axis=1)
    profile = np.convolve(np.pad(part, 1, mode="edge"), np.full(3, 1 / 3), "valid")
    half_grey = (dark_grey + float(profile.max())) / 2
    bright = np.flatnonzero(profile > half_grey)
    if len(bright) < 3 or profile.max() < dark_grey + least_grey:
        return None
    last = int(bright[-1])
    if last + 1 >= len(profile):
        return None  # it goes over into tissue
    fall = profile[last] - profile[last + 1]
    return float(top + last + (profile[last] - half_grey) / fall)


def _slope(x_px: Floats, row_px: Floats) -> float:
    """Return by how much rows grow with columns, by least squares; 0 for too few to tell."""
    off = x_px - x_px.mean()
    return float(off @ row_px) / float(off @ off) if len(x_px) == SLOPE_COLUMNS else 0.0


def row_at(x_px: Floats, row_px: Floats, seen: Mask, at_x_px: float) -> float:
    """Return a surface's row in a column; beyond where it was seen it goes on straight.

    Args:
        x_px: Columns, rising, (n,).
        row_px: Rows of the surface in them, (n,).
        seen: Where they mean something, (n,).
        at_x_px: The column.
    """
    x, row = x_px[seen], row_px[seen]
    if not len(x):
        return math.inf
    if len(x) > SLOPE_COLUMNS and not x[0] <= at_x_px <= x[-1]:
        end = slice(0, SLOPE_COLUMNS) if at_x_px < x[0] else slice(-SLOPE_COLUMNS, None)
        return float(row[end].mean() + _slope(x[end], row[end]) * (at_x_px - x[end].mean()))
    return float(np.interp(at_x_px, x, row))
