"""The two edges of the shaft, sub-pixel, block by block.

Turns a strip into pairs of edges. Edges are maxima of the slope across the shaft; the middle of both does not
care how the metal between them is lit. The two edges of one thing have slopes of opposite sign: a dark needle
falls and rises, a bright one rises and falls. The edge of a shaded side beside a highlight has no maximum of
its own, but every edge has a foot, where the image begins to change, and all feet are equally far out. They
suffer more from noise. Knows no line: whether pairs lie on one is `shaft`'s to tell.
"""

import math
from functools import cache
from typing import Any

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from numpy.typing import NDArray

from haptigraph.perception.pixels import FloatImage, Floats, Mask
from haptigraph.perception.strip import STATION_PX, Strip, median

__all__ = [
    "BLOCK",
    "BLOCK_PX",
    "LEAST_BLOCKS",
    "NOISY_GREY",
    "UNSEEN_PX",
    "Edges",
    "Slopes",
    "at_feet",
    "find_edges",
]

BLOCK = round(6 / STATION_PX)
"""Stations that are looked at together."""

BLOCK_PX = BLOCK * STATION_PX
"""From block to block."""

LEAST_BLOCKS = 3
"""Fewer make no line."""

UNSEEN_PX = -100.0
"""Width of a pair of edges that is not there."""

SIGMA_PX = 1.0  # of the slope filter: about the blur of a focused lens
LEAST_SNR = 5.0
LEAST_SLOPE = 3.0  # grey levels per px: softer is shadow or texture
FAINT, STRONG = 0.08, 0.5  # shares of the steepest slope of any sign, of the same sign
FLOOR_PX = 0.3  # what light on metal, and ground as bright, do to an edge, however little noise there is
_TAPS = np.arange(-3, 4, dtype=np.float64)
_BELL = _TAPS * np.exp(-(_TAPS**2) / (2 * SIGMA_PX**2))
SLOPE = (_BELL / (_BELL * _TAPS).sum()).astype(np.float32)
SLOPE_NOISE = float((SLOPE**2).sum())
CURVE_NOISE = float((np.diff(SLOPE, prepend=0, append=0) ** 2).sum())
SLOPE_BLUR_PX2 = SIGMA_PX**2 + 0.25  # of the slope filter, and of a maximum's curvature by its neighbours
NOISY_GREY = LEAST_SLOPE * math.sqrt(BLOCK / SLOPE_NOISE) / LEAST_SNR
"""With more noise an edge must be steeper to be told from it than to be told from a shadow's."""

SPARE_PX = 4  # of a strip's half width is not searched for edges
FOOT_PX = 1.4  # from an edge to its foot, through a focused lens and the slope filter
FOOT_SHARE = 0.15  # of the sharpest bend of the same sign
FOOT_SNR, USUAL_FOOT_SNR = 6.0, 12.0


class Slopes(Struct, frozen=True, eq=False):
    """Slopes across the shaft in n blocks."""

    both: FloatImage
    """Grey levels per px, and the same with the other sign, (lanes, 2, n)."""
    noise_grey: float
    """Standard deviation of a block's sum over its stations' number."""
    about: FloatImage
    """Where, from the second lane on, the steep places lie by and large, (n,)."""
    half_px: int
    """Lanes reach so far to either side."""

    def is_near(self, lanes: FloatImage) -> Mask:
        """Return which lanes, from the second one on, are near the steep places, (lanes, n)."""
        return np.asarray(np.abs(lanes[:, None] - self.about) <= self.half_px - SPARE_PX, np.bool_)


class Edges(Struct, frozen=True, eq=False):
    """Both edges of the shaft in n blocks, as pairs: one row of those that rise first, one that fall."""

    u_px: FloatImage
    """Middle of every block along the strip, (n,)."""
    outside: int
    """How many of the blocks are before the wall; they come first."""
    middle_px: Floats
    """Half-way between a pair's edges, across the strip from its middle, (2, n)."""
    variance_px2: Floats
    """Of that, (2, n)."""
    width_px: Floats
    """Between them, (2, n); UNSEEN_PX where there is no such pair."""
    steepness: FloatImage
    """Slope of the fainter one [grey levels per px], (2, n)."""
    blurs_px2: tuple[FloatImage, FloatImage]
    """Variance of the blur of the left and of the right one, the slope filter's with it, (2, n) each."""
    slopes: Slopes
    """What they were found in."""

    def usual_blur_px(self, is_pair: Mask) -> float:
        """Return the usual deviation of the blur of some pairs' edges, on the sharper side.

        Args:
            is_pair: Which pairs, (2 n,).
        """
        sharper_px2 = min(median(blur.ravel()[is_pair]) for blur in self.blurs_px2)
        return math.sqrt(max(sharper_px2 - SLOPE_BLUR_PX2, 0.0))


def find_edges(strip: Strip, tip_px: float, block: int = BLOCK) -> Edges | None:
    """Find the outermost edge of either sign on either side of where the steep places lie.

    Args:
        strip: The straightened surroundings of the shaft.
        tip_px: Where along it the needle ends, roughly.
        block: How many stations are looked at together.

    Returns:
        The edges, or None if too little of the shaft is visible.
    """
    last = max(math.floor((tip_px - float(strip.u_px[0])) / STATION_PX), 0)
    parts = [_whole_blocks(part, last, block) for part in (strip.before, strip.inside)]
    outside, inside = ((part.stop - part.start) // block for part in parts)
    if outside + inside < LEAST_BLOCKS:
        return None
    middles = [slice(part.start + block // 2, part.stop, block) for part in parts]
    u_px = np.concatenate([strip.u_px[middle] for middle in middles])
    noise = strip.noise_grey / math.sqrt(block)
    sums = np.concatenate([_sums(strip.excess, part, block) for part in parts], axis=1)
    rising = _slopes(len(sums), block) @ sums
    both = np.concatenate([rising, -rising], axis=1).reshape(len(rising), 2, -1)
    about = _rough_middle(rising, u_px)
    slopes = Slopes(both, noise, about, strip.half_px)
    is_edge = _is_edge(slopes)
    has_edge = np.logical_or.reduce(is_edge)
    ends = np.array([is_edge.argmax(axis=0), len(is_edge) - 1 - is_edge[::-1].argmax(axis=0)])
    shift_px, curvature, height = _peaks(both, ends)
    left_px, right_px = _paired(ends + shift_px)
    left_px2, right_px2 = _paired(curvature**-2)
    is_pair = has_edge & has_edge[::-1] & (left_px < about) & (right_px > about)
    return Edges(
        u_px,
        outside,
        middle_px=(left_px + right_px) / 2 - (strip.half_px - 1),
        variance_px2=(CURVE_NOISE * noise**2 / 4) * (left_px2 + right_px2) + FLOOR_PX**2,
        width_px=np.where(is_pair, right_px - left_px, UNSEEN_PX),
        steepness=np.minimum(*_paired(height)),
        blurs_px2=_paired(height / curvature),
        slopes=slopes,
    )


def at_feet(edges: Edges) -> Edges | None:
    """Return the same pairs with their edges where the outermost feet say; None if these drown in noise.

    Pairs without two feet stay as they are.
    """
    slopes = edges.slopes
    bend = np.diff(slopes.both, axis=0)
    bends = np.stack([bend, -bend[:, ::-1]], axis=1)  # left, right; both have the sign of the left edge
    most = bends.max(axis=0)
    noise = slopes.noise_grey * math.sqrt(CURVE_NOISE)
    if median(most) < USUAL_FOOT_SNR * noise:
        return None
    inner = bends[1:-1]  # its lanes, half-way between those of `both`, are counted from the second one on
    is_foot = (inner > bends[2:]) & (inner >= bends[:-2])
    is_foot &= inner >= np.maximum(FOOT_SHARE * most.max(axis=1, keepdims=True), FOOT_SNR * noise)
    is_foot &= slopes.is_near(_moments(len(inner))[1] + np.float32(0.5))[:, None, None]
    ends = np.array([is_foot[:, 0].argmax(axis=0), len(inner) - 1 - is_foot[::-1, 1].argmax(axis=0)])
    left_px, right_px = ends + _peaks(bends, ends)[0] + 0.5
    left_px, right_px = left_px + FOOT_PX, right_px - FOOT_PX
    are_both = is_foot.any(axis=0).all(axis=0) & (edges.width_px > 0) & (right_px > left_px)
    middle_px = (left_px + right_px) / 2 - (slopes.half_px - 1)
    return replace(
        edges,
        middle_px=np.where(are_both, middle_px, edges.middle_px),
        width_px=np.where(are_both, right_px - left_px, edges.width_px),
    )


def _whole_blocks(part: slice, last: int, block: int) -> slice:
    """Return the stations of all whole blocks of a part before some station."""
    stop = min(part.stop, last)
    return slice(part.start, max(stop - (stop - part.start) % block, part.start))


def _sums(excess: FloatImage, part: slice, block: int) -> FloatImage:
    """Return every block's sum, (lanes, blocks)."""
    first, *others = (excess[:, part.start + station : part.stop : block] for station in range(block))
    for other in others:
        first = first + other
    return first


def _paired(values: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return what belongs to the left and the right edge of every pair, (2, n) each.

    Args:
        values: Of the outermost edges on the left and on the right, of either sign, (2, 2, n).
    """
    return values[0], values[1, ::-1]  # a pair's right edge has the other sign


@cache
def _slopes(lanes: int, block: int) -> FloatImage:
    """Return what makes slopes across from blocks' sums, (lanes, lanes); the outermost lanes go on."""
    reach = len(SLOPE) // 2
    slopes = np.zeros((lanes, lanes), np.float32)
    for lane in range(lanes):
        for tap, weight in enumerate(SLOPE, lane - reach):
            slopes[lane, min(max(tap, 0), lanes - 1)] += weight / block
    return slopes


@cache
def _moments(lanes: int) -> FloatImage:
    """Return what makes the sum over lanes and the first moment, (2, lanes)."""
    return np.stack([np.ones(lanes), np.arange(lanes)]).astype(np.float32)


def _is_edge(slopes: Slopes) -> Mask:
    """Return where slopes are steepest and steep enough, not too far from the middle, (lanes - 2, 2, n)."""
    both, noise_grey = slopes.both, slopes.noise_grey
    most = both.max(axis=0)
    least = np.maximum(STRONG * most, FAINT * most[::-1])
    least = np.maximum(least, max(LEAST_SNR * noise_grey * math.sqrt(SLOPE_NOISE), LEAST_SLOPE))
    inner = both[1:-1]  # lanes from here on are those of `inner`, one less than the strip's
    is_edge = (inner > both[2:]) & (inner >= both[:-2])
    is_edge &= inner >= least
    is_edge &= slopes.is_near(_moments(len(inner))[1])[:, None]
    return np.asarray(is_edge, np.bool_)


def _rough_middle(rising: FloatImage, u_px: FloatImage) -> FloatImage:
    """Return where, from the second lane on, the steep places lie by and large, (n,).

    A resistant line, through the medians of the outer thirds (Tukey, Exploratory Data Analysis, 1977).
    """
    power = np.square(rising[1:-1])
    total, moment = _moments(len(power)) @ power
    middle = moment / np.maximum(total, np.float32(1e-6))
    third = (len(middle) + 2) // 3
    first, last = median(middle[:third]), median(middle[-third:])
    start, end = float(u_px[third // 2]), float(u_px[-1 - third // 2])
    slope = (last - first) / (end - start) if end > start else 0.0
    return np.asarray(u_px * slope + (first - slope * start), np.float32)


def _peaks(both: FloatImage, lanes: NDArray[np.int64]) -> tuple[FloatImage, FloatImage, FloatImage]:
    """Return sub-pixel shifts, curvatures and heights of maxima on two sides, (2, 2, n) each.

    The noise of a maximum's place is the noise of the derivative there over the curvature.
    """
    lane = both[0].size
    places = lanes * lane + np.arange(lane).reshape(both[0].shape)
    before, at, after = both.take(places), both.take(places + lane), both.take(places + 2 * lane)
    curvature = np.maximum(2 * at - before - after, np.float32(1e-3))
    return (after - before) / (2 * curvature), curvature, at
