"""The needle in one B-scan: a thin bright ridge on dark speckle.

Turns an image (px) into straight lines that may be a shaft, each with its brightness along the way. A ridge
is brighter than both of its sides, which the edge of a layer is not. Whether a line is a needle or the ghost
of one is for the caller to say, who knows where light is missing.
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

COARSE = 3  # the image is searched at a third of its size
SIDE_PX = 4  # from the ridge to its dark sides, at that size
LEAST_DEVIATIONS, LEAST_GREY = 3.5, 14.0  # above both sides
FLATTEST_DEG, STEEPEST_DEG = 14.0, 86.0
TURN_RAD, VOTES, LOOKED_AT, TRIED, MOST_RIDGES = math.radians(1.5), 12, 50, 2, 2
ERASED_PX, BELOW_ILM_PX = 7, 12.0
HALF_PX, CORE_PX, FLANK_PX = (
    11,
    2,
    7,
)  # half widths of what is sampled, of the ridge, and from where on its sides are
ALONG_PX = 5  # averaged along the ridge
CORE = np.full(2 * CORE_PX + 1, 1 / (2 * CORE_PX + 1), np.float32)
FLANK = np.full(HALF_PX - FLANK_PX + 1, 1 / (HALF_PX - FLANK_PX + 1), np.float32)
LOOKS = ((3, 1), (1, 3))  # (px of the way, fits): first every third px, roughly
LEAST_SAMPLES = 5
MISS_PX = 1.5
LONGEST_GAP_PX, SURE_PX = 24, 40  # of the ridge; so much of it before a gap is enough

Strip = NDArray[np.floating[Any]]


class Ridge(NamedTuple):
    """A straight line from where it enters the image downwards, and what lies along it."""

    start_px: Vec
    along_px: Vec
    """Direction, length 1; it points down."""
    height_grey: Strip
    """How much brighter it is than its sides, at each px of the way, (n,)."""
    side_grey: Strip
    """Its brighter side, (n,)."""
    angle_sd_deg: float

    def at_px(self, way_px: float) -> Vec:
        """Return the place so far along."""
        return self.start_px[0] + way_px * self.along_px[0], self.start_px[1] + way_px * self.along_px[1]

    def way_at_column(self, x_px: float) -> float:
        """Return how far along a column lies [px]."""
        return (x_px - self.start_px[0]) / self.along_px[0]


def find_ridges(image: Image, ilm_px: Floats, dark_grey: float, sd_grey: float) -> list[Ridge]:
    """Return what may be shafts, those with most evidence first.

    Args:
        image: (h, w) grey.
        ilm_px: Row of the ILM in each column, the image's height where there is none, (w,); only what lies
            above counts.
        dark_grey: The most that lies beside a needle.
        sd_grey: Of the noise of a single pixel.
    """
    height, width = image.shape
    size = width // COARSE, height // COARSE
    middles = tuple(slice(COARSE // 2, COARSE * length, COARSE) for length in size[::-1])
    small = np.asarray(cv2.blur(image, (COARSE, COARSE))[middles], np.uint8, order="C")  # resizes, quicker
    mask = _ridge_mask(small, dark_grey, sd_grey)
    limit = (ilm_px[: COARSE * mask.shape[1] : COARSE] + BELOW_ILM_PX) / COARSE
    mask[np.arange(mask.shape[0])[:, None] > limit] = 0
    ridges: list[Ridge] = []
    while len(ridges) < MOST_RIDGES:
        if cv2.countNonZero(mask) < VOTES:
            break
        lines = cv2.HoughLines(mask, 1.0, TURN_RAD, VOTES)
        entering = (
            _entering(COARSE * float(rho), float(theta), (width, height))
            for rho, theta in (() if lines is None else lines[:LOOKED_AT, 0])
        )
        tried = islice((line for line in entering if line is not None), TRIED)
        ridge = next(filter(None, (_followed(image, *line, sd_grey) for line in tried)), None)
        if ridge is None:
            break
        ridges.append(ridge)
        _erase(mask, ridge)
    return ridges


def _erase(mask: Image, ridge: Ridge) -> None:
    """Take a ridge out of a mask, in place."""
    start, end = (
        (round(x / COARSE), round(y / COARSE))
        for x, y in (ridge.start_px, ridge.at_px(len(ridge.height_grey)))
    )
    cv2.line(mask, start, end, 0, ERASED_PX)


def _ridge_mask(small: Image, dark_grey: float, sd_grey: float) -> Image:
    """Return where an image is brighter than on both sides, to the left and right or above and below."""
    core, side = cv2.blur(small, (2, 2)), cv2.blur(small, (3, 3))
    least = max(LEAST_GREY, LEAST_DEVIATIONS * sd_grey / (2 * COARSE))
    mask = np.zeros_like(small)
    s = SIDE_PX
    beside = cv2.max(side[:, : -2 * s], side[:, 2 * s :])
    mask[:, s:-s] = (cv2.subtract(core[:, s:-s], beside) > least) & (beside < dark_grey)
    above = cv2.max(side[: -2 * s], side[2 * s :])
    mask[s:-s] |= (cv2.subtract(core[s:-s], above) > least) & (above < dark_grey)
    return mask


def _entering(rho_px: float, theta: float, size_px: tuple[int, int]) -> tuple[Vec, Vec] | None:
    """Return where a line enters an image from above or from a side, and its way down; None if too flat."""
    dx, dy = -math.sin(theta), math.cos(theta)
    if dy < 0:
        dx, dy = -dx, -dy
    if not FLATTEST_DEG <= math.degrees(math.atan2(dy, abs(dx))) <= STEEPEST_DEG:
        return None
    x, y = rho_px * math.cos(theta), rho_px * math.sin(theta)
    top_px = x - y * dx / dy
    side_px = min(max(top_px, 0.0), size_px[0] - 1.0)
    if side_px != top_px and (side_px > 0) == (dx > 0):
        return None  # it goes away from the image
    start_px = side_px, (side_px - top_px) * dy / dx if dx else 0.0
    return (start_px, (dx, dy)) if start_px[1] < size_px[1] else None


def _followed(image: Image, start_px: Vec, along_px: Vec, sd_grey: float) -> Ridge | None:
    """Return the ridge along a line, laid through its middle; None if there is too little of it."""
    least = max(LEAST_GREY, LEAST_DEVIATIONS * sd_grey / (ALONG_PX * (2 * CORE_PX + 1)) ** 0.5)
    for step_px, fits in LOOKS:
        strip = _strip(image, start_px, along_px, step_px)
        if strip is None:
            return None
        core, (one, other) = _core(strip), _sides(strip)
        mean, most = (one + other) / 2, np.maximum(one, other)
        fit = _fitted(strip, core, mean, core - most > least, step_px, fits)
        if fit is None:
            return None
        offset_px, slope, deviation_rad = fit
        x, y = start_px[0] - offset_px * along_px[1], start_px[1] + offset_px * along_px[0]
        along_px = rotate(along_px, math.degrees(math.atan(slope)))
        line = _entering(*_normal_form((x, y), along_px), (image.shape[1], image.shape[0]))
        if line is None:
            return None
        start_px, along_px = line
    return Ridge(start_px, along_px, core - mean, most, math.degrees(deviation_rad))


def _normal_form(at_px: Vec, along_px: Vec) -> tuple[float, float]:
    """Return a line as (rho, theta)."""
    theta = math.atan2(-along_px[0], along_px[1])
    return at_px[0] * math.cos(theta) + at_px[1] * math.sin(theta), theta


def _strip(image: Image, start_px: Vec, along_px: Vec, step_px: int) -> Strip | None:
    """Return what lies along a line: one row a step of the way, across from left to right seen along it."""
    (x, y), (dx, dy), (height, width) = start_px, along_px, image.shape
    sideways_px = ((width - 1 - x) / dx if dx > 0 else x / -dx) if dx else math.inf
    length = int(min((height - 1 - y) / dy, sideways_px))
    if length < LEAST_SAMPLES * ALONG_PX:
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


def _core(strip: Strip) -> Strip:
    return np.asarray(strip[:, HALF_PX - CORE_PX : HALF_PX + CORE_PX + 1] @ CORE)


def _sides(strip: Strip) -> tuple[Strip, Strip]:
    return strip[:, : HALF_PX - FLANK_PX + 1] @ FLANK, strip[:, HALF_PX + FLANK_PX :] @ FLANK


def _unbroken(way: NDArray[np.intp], step_px: int) -> NDArray[np.intp]:
    """Return the places before the first long gap, unless they are few: tissue beyond the tip is no shaft."""
    gaps = np.flatnonzero(np.diff(way) * step_px > LONGEST_GAP_PX)
    end = int(gaps[0]) + 1 if len(gaps) else len(way)
    return way[:end] if end * step_px >= SURE_PX else way


def _fitted(
    strip: Strip, core: Strip, side: Strip, is_ridge: NDArray[np.bool_], step_px: int, fits: int
) -> tuple[float, float, float] | None:
    """Return offset at the start, slope and its deviation of the ridge's middle; None if it is too short."""
    way = _unbroken(np.flatnonzero(is_ridge), step_px)
    if len(way) * step_px < LEAST_SAMPLES * ALONG_PX:
        return None
    near = strip[way, HALF_PX - FLANK_PX : HALF_PX + FLANK_PX + 1]
    weight = np.maximum(near - (0.6 * side[way] + 0.4 * core[way])[:, None], 0).astype(np.float64)
    across = np.arange(-FLANK_PX, FLANK_PX + 1)
    middle = weight @ across / np.maximum(weight.sum(axis=1), 1e-9)
    way, keep = way * step_px, np.ones(len(way), bool)
    for _ in range(fits):
        at, about = way[keep], middle[keep]
        n = len(at)
        if n < LEAST_SAMPLES:
            return None
        at_mean, about_mean = float(at.sum()) / n, float(about.sum()) / n
        off = at - at_mean
        spread = max(float(off @ off), 1e-9)
        slope = float(off @ (about - about_mean)) / spread
        miss = np.abs(middle - about_mean - slope * (way - at_mean))
        keep = miss <= max(MISS_PX, 2 * float(miss[keep].sum()) / n)
    variance_px2 = float(miss[keep] @ miss[keep]) / n * (ALONG_PX / step_px)  # neighbours share their pixels
    return about_mean - slope * at_mean, slope, math.sqrt(variance_px2 / spread)
