"""The shaft's middle line, from the sub-pixel places of its two edges.

Turns a strip into a line with its covariance. Edges are maxima of the slope across the shaft, found in
blocks of rows; the middle of both edges does not care how the metal between them is lit. Knows no trocar
and no time.
"""

import math

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.perception.pixels import FloatImage, Mask
from haptigraph.perception.strip import Strip, median

__all__ = ["Edges", "LineFit", "fit_line"]

BLOCK = 6
SIGMA_PX = 1.0  # of the slope filter: about the blur of a focused lens
LEAST_SNR = 5.0
LEAST_SLOPE = 3.0  # grey levels per px: softer is shadow or texture
FAINT, STRONG = 0.08, 0.35  # shares of the steepest slope on the same side of the same block
PAIRS = np.array([0, 1, 0, 1]), np.array([2, 3, 3, 2])  # left, right: each faint, strong
LEAST_BLOCKS = 3
TUKEY = 4.0
ROUNDS = 3
FLOOR_PX = 0.12  # what light on the metal does to an edge, however little noise there is
UNKNOWN_FLOOR_PX = 0.8  # what an unknown background does to it: it may hide a side of the shaft
LEAST_SCATTER = 0.05  # of residuals over expected deviations, squared
NEAR_PX = 3.0
LEAST_STEEP = 0.25  # of the shaft's edges: softer ones are its shadow's
AHEAD = 6  # blocks nearer the tip that a block's width is compared with
NARROWER_PX = 1.2
WIDER_PX = 3.0
MISS_PX = 3.0
LEAST_MISS_PX = 0.6
SIDE_PX = 0.2  # how far the light may shift the middle on one side of the wall as a whole
SCALE_PX = 100.0  # keeps the normal equations well conditioned
PER_PX = np.array([[1, 1 / SCALE_PX], [1 / SCALE_PX, 1 / SCALE_PX**2]])
PRIOR = np.diag([1e-6, 1e-6, SIDE_PX**-2, SIDE_PX**-2])

_TAPS = np.arange(-3, 4, dtype=np.float64)
_BELL = _TAPS * np.exp(-(_TAPS**2) / (2 * SIGMA_PX**2))
SLOPE = (_BELL / (_BELL * _TAPS).sum()).astype(np.float32)
SLOPE_NOISE = float((SLOPE**2).sum())
CURVE_NOISE = float((np.diff(SLOPE, prepend=0, append=0) ** 2).sum())


class Edges(Struct, frozen=True, eq=False):
    """Both edges of the shaft, block by block."""

    u_px: FloatImage
    """Middle of every block along the strip, (n,)."""
    middle_px: FloatImage
    """Half-way between them, across the strip from its middle, (4, n): outermost pair first."""
    variance_px2: FloatImage
    """Of that, (4, n)."""
    width_px: FloatImage
    """Between the outermost, (n,)."""
    steepness: FloatImage
    """Slope of the fainter one [grey levels per px], (n,)."""
    is_outside: Mask
    """Blocks before the wall, (n,)."""
    is_seen: Mask
    """Blocks where both were found, (n,)."""


class LineFit(Struct, frozen=True, eq=False):
    """A straight line across a strip: v = offset_px + slope u."""

    offset_px: float
    slope: float
    covariance: NDArray[np.float64]
    """Of (offset_px, slope), (2, 2)."""
    edges: Edges
    is_on_line: Mask
    """Blocks whose edges agree with the line, (n,)."""

    @property
    def confidence(self) -> float:
        """Share of the blocks that show both edges on the line."""
        return float(self.is_on_line.mean())

    def end_px(self, from_px: float) -> float:
        """Return how far along the strip there are edges by the line; gaps count against it."""
        beyond = np.flatnonzero(self.edges.u_px >= from_px)
        if not len(beyond):
            return from_px + BLOCK
        edges = self.edges
        miss = np.abs(edges.middle_px[0, beyond] - self.v_px(edges.u_px[beyond]))
        steep = edges.steepness[beyond] > LEAST_STEEP * median(edges.steepness[self.is_on_line])
        kept = np.cumsum(np.where(edges.is_seen[beyond] & steep & (miss <= NEAR_PX), 1, -1))
        last = int(kept.argmax())
        return float(self.edges.u_px[beyond[last]]) + BLOCK if kept[last] > 0 else from_px + BLOCK

    def v_px(self, u_px: FloatImage) -> FloatImage:
        """Return the line's place across the strip."""
        return np.asarray(self.offset_px + self.slope * u_px, np.float32)


class _Slopes(Struct, frozen=True, eq=False):
    """The slope across a strip in blocks of rows."""

    u_px: FloatImage
    is_outside: Mask
    is_known: Mask
    """Blocks where the empty eye is known, (n,)."""
    signed: FloatImage
    """Grey levels per pixel, (n, columns)."""
    steep: FloatImage
    """Its size where it has a local maximum that is no noise, else 0."""
    half_px: int
    noise_grey: float
    """Of a pixel, averaged over a block."""


def fit_line(strip: Strip, tip_px: float, miss_px: float) -> LineFit | None:
    """Fit the shaft's middle line to all visible rows before the tip.

    Args:
        strip: The straightened surroundings.
        tip_px: Where the needle ends, roughly.
        miss_px: How far the shaft may be from the strip's middle.

    Returns:
        The line, or None if too few blocks show two edges that lie on one.
    """
    slopes = _slopes(strip, tip_px)
    return _robust_line(_find_edges(slopes), miss_px) if len(slopes.u_px) >= LEAST_BLOCKS else None


def _slopes(strip: Strip, before_px: float) -> _Slopes:
    last = max(math.floor(before_px - float(strip.u_px[0])), 0)
    parts = []
    for rows in (strip.before, strip.inside):
        count = max(min(rows.stop, last) - rows.start, 0) // BLOCK
        part = slice(rows.start, rows.start + count * BLOCK)
        blocks = strip.excess[part].reshape(count, BLOCK, 2 * strip.half_px + 1).sum(axis=1) / BLOCK
        is_known = strip.is_known[part].reshape(count, BLOCK).all(axis=1)
        parts.append((strip.u_px[part][::BLOCK] + (BLOCK - 1) / 2, is_known, blocks))
    u_px, is_known, blocks = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    is_outside = u_px < (strip.u_px[strip.before.stop - 1] if strip.before.stop else -math.inf)
    noise = strip.noise_grey / math.sqrt(BLOCK)
    if not len(u_px):
        return _Slopes(u_px, is_outside, is_known, blocks, blocks, strip.half_px, noise)
    signed = np.asarray(cv2.filter2D(blocks, cv2.CV_32F, SLOPE[None]), np.float32)
    size = np.abs(signed)
    middle = size[:, 1:-1]
    is_peak = (middle >= size[:, :-2]) & (middle > size[:, 2:])
    is_peak &= middle >= max(LEAST_SNR * noise * math.sqrt(SLOPE_NOISE), LEAST_SLOPE)
    steep = np.zeros_like(size)
    steep[:, 1:-1] = middle * is_peak
    return _Slopes(u_px, is_outside, is_known, signed, steep, strip.half_px, noise)


def _find_edges(slopes: _Slopes) -> Edges:
    """Find, on either side of the strip's middle, the outermost faint and the outermost strong edge."""
    middle = slopes.half_px
    left, right = slopes.steep[:, : middle + 1], slopes.steep[:, middle:][:, ::-1]
    columns = []
    for side in (left, right):
        most = side.max(axis=1, keepdims=True)
        most = np.maximum(most, median(most))
        columns += [(side > share * most).argmax(axis=1) for share in (FAINT, STRONG)]
    columns[2:] = [2 * middle - column for column in columns[2:]]
    is_seen = np.asarray((left > 0).any(axis=1) & (right > 0).any(axis=1), np.bool_)
    return _edges(slopes, np.stack(columns), is_seen)


def _is_whole(edges: Edges) -> Mask:
    """Tell which blocks show the shaft as wide as a taper can be.

    If it is narrower than nearer the tip, an outer edge was missed; if it is far wider, one is something
    else's.
    """
    ahead = np.concatenate([np.where(edges.is_seen, edges.width_px, 0)[1:], np.zeros(AHEAD)])
    windows = np.lib.stride_tricks.sliding_window_view(ahead, AHEAD)
    ranked = np.sort(windows, axis=1)
    usual, most = ranked[:, -2], np.where(ranked[:, -1] > 0, ranked[:, -1], np.inf)
    is_likely = (edges.width_px >= usual - NARROWER_PX) & (edges.width_px <= most + WIDER_PX)
    return np.asarray(edges.is_seen & is_likely, np.bool_)


def _edges(slopes: _Slopes, columns: NDArray[np.int64], is_seen: Mask) -> Edges:
    """Refine the columns of slope maxima, (4, n), to sub-pixel places with variances.

    The noise of a maximum's place is the noise of the derivative there over the curvature.
    """
    columns = np.clip(columns, 1, 2 * slopes.half_px - 1)
    rows = np.arange(columns.shape[1])
    around = np.abs(slopes.signed[rows[:, None], columns[..., None] + np.arange(-1, 2)])
    before, at, after = around[..., 0], around[..., 1], around[..., 2]
    curvature = np.maximum(2 * at - before - after, 1e-3)
    place = columns - slopes.half_px + np.clip((after - before) / (2 * curvature), -1, 1)
    variance = CURVE_NOISE * slopes.noise_grey**2 / curvature**2
    floor_px = np.where(slopes.is_known, FLOOR_PX, UNKNOWN_FLOOR_PX)
    left, right = PAIRS
    return Edges(
        slopes.u_px,
        middle_px=(place[left] + place[right]) / 2,
        variance_px2=(variance[left] + variance[right]) / 4 + floor_px**2,
        width_px=place[2] - place[0],
        steepness=at.min(axis=0),
        is_outside=slopes.is_outside,
        is_seen=is_seen,
    )


def _robust_line(edges: Edges, miss_px: float) -> LineFit | None:
    """Fit by weighted least squares, leaving out blocks that are off the line (Tukey's weights).

    The light differs on the two sides of the wall, and with it where edges appear: each side as a whole may
    be off by SIDE_PX, two more unknowns with that as their prior. A bright needle with dark rims has two
    edges on either side, and rims do not show everywhere: after a first line from the outermost pairs of
    blocks that look whole, every block joins with that pair whose middle is nearest to the line.
    """
    chosen = np.flatnonzero(edges.is_seen)
    if len(chosen) < LEAST_BLOCKS:
        return None
    u, each = edges.u_px[chosen], np.arange(len(chosen))
    middle, trust = edges.middle_px[:, chosen], 1 / edges.variance_px2[:, chosen]
    outside = edges.is_outside[chosen]
    design = np.stack([np.ones(len(u)), u / SCALE_PX, outside, ~outside])
    pair, reach, line = np.zeros(len(u), np.int64), miss_px, np.zeros(len(u))
    usable = _is_whole(edges)[chosen]
    for number in range(ROUNDS):
        if number:
            distances = np.abs(middle - line)
            pair = distances.argmin(axis=0)
            reach = min(max(TUKEY * 1.4826 * median(distances.min(axis=0)), LEAST_MISS_PX), MISS_PX)
        v, belief = middle[pair, each], trust[pair, each]
        closeness = (1 - np.minimum(np.abs(v - line) / reach, 1) ** 2) * usable
        weighed = design * (belief * closeness * closeness)
        covariance = np.linalg.inv(weighed @ design.T + PRIOR)
        answer = covariance @ (weighed @ v)
        line = answer @ design
    on = chosen[closeness > 0]
    if len(on) < LEAST_BLOCKS:
        return None
    residual = v - line
    scatter = max(float((belief * (closeness > 0)) @ residual**2) / max(len(on) - 2, 1), LEAST_SCATTER)
    is_on_line = np.zeros(len(edges.u_px), np.bool_)
    is_on_line[on] = True
    line_covariance = covariance[:2, :2] * (scatter * PER_PX)
    return LineFit(float(answer[0]), float(answer[1]) / SCALE_PX, line_covariance, edges, is_on_line)
