"""Ridges in a B-scan: thin bright lines on dark speckle that may be a needle's shaft.

Turns an image (px) into straight lines, each with its brightness along the line. A ridge is brighter than
both of its sides, unlike the edge of a layer. The caller decides by its shadow whether a ridge is a needle or
the ghost of one.
"""

import math
from itertools import islice
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.geometry import Vec, rotate
from haptigraph.imaging import Floats
from haptigraph.messages import Image

__all__ = ["Ridge", "find_ridges"]

DOWNSAMPLING = 3  # factor of the image that is searched
SIDE_PX = 4  # from the ridge to its dark sides, in the downsampled image
MIN_CONTRAST_SD, MIN_CONTRAST_GREY = 3.5, 14.0  # above both sides
MIN_SLOPE_DEG, MAX_SLOPE_DEG = 14.0, 86.0
TURN_RAD, VOTES, MAX_LINES, MAX_FITS, MAX_RIDGES = math.radians(1.5), 12, 50, 2, 2
ERASED_PX, BELOW_ILM_PX = 7, 12.0
HALF_PX, CORE_PX, FLANK_PX = 11, 2, 7  # half widths of the strip and of the ridge; start of the sides
ALONG_PX = 5  # averaged along the ridge
CORE = np.full(2 * CORE_PX + 1, 1 / (2 * CORE_PX + 1), np.float32)
FLANK = np.full(HALF_PX - FLANK_PX + 1, 1 / (HALF_PX - FLANK_PX + 1), np.float32)
PASSES = ((3, 1), (1, 3))  # (px between samples, fits): coarse first
MIN_SAMPLES = 5
INLIER_PX = 1.5
MAX_GAP_PX, MIN_RUN_PX = 24, 40  # of the ridge; a run of this length before a gap suffices

Samples = NDArray[np.floating[Any]]


class Ridge(NamedTuple):
    """A straight line from its entry into the image downwards, with its brightness."""

    start_px: Vec
    along_px: Vec
    """Direction, length 1; it points down."""
    height_grey: Samples
    """Contrast against its sides at each px along the line, (n,)."""
    side_grey: Samples
    """Brightness of its brighter side, (n,)."""
    angle_sd_deg: float

    def at_px(self, distance_px: float) -> Vec:
        """Return the point at a distance along the line."""
        return self.start_px[0] + distance_px * self.along_px[0], self.start_px[
            1
        ] + distance_px * self.along_px[1]

    def distance_at_column(self, x_px: float) -> float:
        """Return the distance along the line at which it crosses a column [px]."""
        return (x_px - self.start_px[0]) / self.along_px[0]


def find_ridges(image: Image, ilm_px: Floats, dark_grey: float, sd_grey: float) -> list[Ridge]:
    """Return the ridges that may be shafts, those with most evidence first.

    Args:
        image: (h, w) grey.
        ilm_px: Row of the ILM in each column, the image's height where there is none, (w,); ridges are
            searched above it.
        dark_grey: Largest grey value beside a needle.
        sd_grey: Standard deviation of the noise of a single pixel.
    """
    height, width = image.shape
    size = width // DOWNSAMPLING, height // DOWNSAMPLING
    middles = tuple(slice(DOWNSAMPLING // 2, DOWNSAMPLING * length, DOWNSAMPLING) for length in size[::-1])
    small = np.asarray(
        cv2.blur(image, (DOWNSAMPLING, DOWNSAMPLING))[middles], np.uint8, order="C"
    )  # faster than cv2.resize
    mask = _ridge_mask(small, dark_grey, sd_grey)
    limit = (ilm_px[: DOWNSAMPLING * mask.shape[1] : DOWNSAMPLING] + BELOW_ILM_PX) / DOWNSAMPLING
    mask[np.arange(mask.shape[0])[:, None] > limit] = 0
    ridges: list[Ridge] = []
    while len(ridges) < MAX_RIDGES:
        if cv2.countNonZero(mask) < VOTES:
            break
        lines = cv2.HoughLines(mask, 1.0, TURN_RAD, VOTES)
        clipped = (
            _clipped_line(DOWNSAMPLING * float(rho), float(theta), (width, height))
            for rho, theta in (() if lines is None else lines[:MAX_LINES, 0])
        )
        candidates = islice((line for line in clipped if line is not None), MAX_FITS)
        ridge = next(filter(None, (_refined_ridge(image, *line, sd_grey) for line in candidates)), None)
        if ridge is None:
            break
        ridges.append(ridge)
        _erase(mask, ridge)
    return ridges


def _erase(mask: Image, ridge: Ridge) -> None:
    """Erase a ridge from a mask, in place."""
    start, end = (
        (round(x / DOWNSAMPLING), round(y / DOWNSAMPLING))
        for x, y in (ridge.start_px, ridge.at_px(len(ridge.height_grey)))
    )
    cv2.line(mask, start, end, 0, ERASED_PX)


def _ridge_mask(small: Image, dark_grey: float, sd_grey: float) -> Image:
    """Return where an image is brighter than both sides, either left and right or above and below."""
    core, side = cv2.blur(small, (2, 2)), cv2.blur(small, (3, 3))
    min_grey = max(MIN_CONTRAST_GREY, MIN_CONTRAST_SD * sd_grey / (2 * DOWNSAMPLING))
    mask = np.zeros_like(small)
    s = SIDE_PX
    beside = cv2.max(side[:, : -2 * s], side[:, 2 * s :])
    mask[:, s:-s] = (cv2.subtract(core[:, s:-s], beside) > min_grey) & (beside < dark_grey)
    above = cv2.max(side[: -2 * s], side[2 * s :])
    mask[s:-s] |= (cv2.subtract(core[s:-s], above) > min_grey) & (above < dark_grey)
    return mask


def _clipped_line(rho_px: float, theta: float, size_px: tuple[int, int]) -> tuple[Vec, Vec] | None:
    """Return a line's entry into an image from the top or a side and its direction; None if too flat."""
    dx, dy = -math.sin(theta), math.cos(theta)
    if dy < 0:
        dx, dy = -dx, -dy
    if not MIN_SLOPE_DEG <= math.degrees(math.atan2(dy, abs(dx))) <= MAX_SLOPE_DEG:
        return None
    x, y = rho_px * math.cos(theta), rho_px * math.sin(theta)
    top_px = x - y * dx / dy
    side_px = min(max(top_px, 0.0), size_px[0] - 1.0)
    if side_px != top_px and (side_px > 0) == (dx > 0):
        return None  # it leaves the image
    start_px = side_px, (side_px - top_px) * dy / dx if dx else 0.0
    return (start_px, (dx, dy)) if start_px[1] < size_px[1] else None


def _refined_ridge(image: Image, start_px: Vec, along_px: Vec, sd_grey: float) -> Ridge | None:
    """Refine a line to the centre of its ridge; None if the ridge is too short."""
    min_grey = max(MIN_CONTRAST_GREY, MIN_CONTRAST_SD * sd_grey / (ALONG_PX * (2 * CORE_PX + 1)) ** 0.5)
    for step_px, fits in PASSES:
        strip = _rectified_strip(image, start_px, along_px, step_px)
        if strip is None:
            return None
        core, (one, other) = _core(strip), _sides(strip)
        mean, brighter = (one + other) / 2, np.maximum(one, other)
        fit = _fit_line(strip, core, mean, core - brighter > min_grey, step_px, fits)
        if fit is None:
            return None
        offset_px, slope, slope_sd_rad = fit
        x, y = start_px[0] - offset_px * along_px[1], start_px[1] + offset_px * along_px[0]
        along_px = rotate(along_px, math.degrees(math.atan(slope)))
        line = _clipped_line(*_normal_form((x, y), along_px), (image.shape[1], image.shape[0]))
        if line is None:
            return None
        start_px, along_px = line
    return Ridge(start_px, along_px, core - mean, brighter, math.degrees(slope_sd_rad))


def _normal_form(at_px: Vec, along_px: Vec) -> tuple[float, float]:
    """Return a line as (rho, theta)."""
    theta = math.atan2(-along_px[0], along_px[1])
    return at_px[0] * math.cos(theta) + at_px[1] * math.sin(theta), theta


def _rectified_strip(image: Image, start_px: Vec, along_px: Vec, step_px: int) -> Samples | None:
    """Rectify the image along a line: one row a step, from left to right as seen along the line."""
    (x, y), (dx, dy), (height, width) = start_px, along_px, image.shape
    sideways_px = ((width - 1 - x) / dx if dx > 0 else x / -dx) if dx else math.inf
    length = int(min((height - 1 - y) / dy, sideways_px))
    if length < MIN_SAMPLES * ALONG_PX:
        return None
    matrix = np.array([[-dy, dx * step_px, x + HALF_PX * dy], [dx, dy * step_px, y - HALF_PX * dx]])
    strip = cv2.warpAffine(
        image,
        matrix,
        (2 * HALF_PX + 1, length // step_px),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return np.asarray(cv2.blur(strip, (1, ALONG_PX // step_px)), np.float32)


def _core(strip: Samples) -> Samples:
    return np.asarray(strip[:, HALF_PX - CORE_PX : HALF_PX + CORE_PX + 1] @ CORE)


def _sides(strip: Samples) -> tuple[Samples, Samples]:
    return strip[:, : HALF_PX - FLANK_PX + 1] @ FLANK, strip[:, HALF_PX + FLANK_PX :] @ FLANK


def _unbroken(distance: NDArray[np.intp], step_px: int) -> NDArray[np.intp]:
    """Return the samples before the first long gap, unless they are few: beyond the tip is tissue."""
    gaps = np.flatnonzero(np.diff(distance) * step_px > MAX_GAP_PX)
    end = int(gaps[0]) + 1 if len(gaps) else len(distance)
    return distance[:end] if end * step_px >= MIN_RUN_PX else distance


def _fit_line(
    strip: Samples, core: Samples, side: Samples, is_ridge: NDArray[np.bool_], step_px: int, fits: int
) -> tuple[float, float, float] | None:
    """Fit a line to the ridge's centre: offset at its start, slope and its SD [rad]; None if too short."""
    distance = _unbroken(np.flatnonzero(is_ridge), step_px)
    if len(distance) * step_px < MIN_SAMPLES * ALONG_PX:
        return None
    window = strip[distance, HALF_PX - FLANK_PX : HALF_PX + FLANK_PX + 1]
    weight = np.maximum(window - (0.6 * side[distance] + 0.4 * core[distance])[:, None], 0).astype(np.float64)
    across = np.arange(-FLANK_PX, FLANK_PX + 1)
    middle = weight @ across / np.maximum(weight.sum(axis=1), 1e-9)
    distance, keep = distance * step_px, np.ones(len(distance), bool)
    for _ in range(fits):
        at, about = distance[keep], middle[keep]
        n = len(at)
        if n < MIN_SAMPLES:
            return None
        at_mean, about_mean = float(at.sum()) / n, float(about.sum()) / n
        off = at - at_mean
        spread = max(float(off @ off), 1e-9)
        slope = float(off @ (about - about_mean)) / spread
        miss = np.abs(middle - about_mean - slope * (distance - at_mean))
        keep = miss <= max(INLIER_PX, 2 * float(miss[keep].sum()) / n)
    variance_px2 = float(miss[keep] @ miss[keep]) / n * (ALONG_PX / step_px)  # neighbours share pixels
    return about_mean - slope * at_mean, slope, math.sqrt(variance_px2 / spread)
