"""The shaft's middle line, from the sub-pixel places of its two edges.

Turns a strip into a line with its covariance. Edges are maxima of the slope across the shaft, found in
blocks of rows; the middle of both edges does not care how the metal between them is lit. The two edges of
one thing have slopes of opposite sign: a dark needle falls and rises, a bright one rises and falls. Knows no
trocar and no time.
"""

import math

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.perception.pixels import FloatImage, Mask
from haptigraph.perception.strip import ROW_PX, Strip, median

__all__ = ["Edges", "LineFit", "fit_line"]

BLOCK_ROWS = round(6 / ROW_PX)
BLOCK_PX = BLOCK_ROWS * ROW_PX
SIGMA_PX = 1.0  # of the slope filter: about the blur of a focused lens
LEAST_SNR = 5.0
LEAST_SLOPE = 3.0  # grey levels per px: softer is shadow or texture
FAINT, STRONG = 0.08, 0.35  # shares of the steepest slope of any sign, of the same sign
LEAST_BLOCKS = 3
TUKEY = 4.0
ROUNDS = 3
FLOOR_PX = 0.12  # what light on the metal does to an edge, however little noise there is
UNKNOWN_FLOOR_PX = 0.3  # what an unknown background does to it: it may hide a side of the shaft
LEAST_SCATTER = 0.05  # of residuals over expected deviations, squared
NEAR_PX = 3.0
LEAST_STEEP = 0.25  # of the shaft's edges: softer ones are its shadow's
NARROWER_PX = 1.2
WIDER_PX = 3.0
MISS_PX = 3.0
LEAST_MISS_PX = 0.6
SIDE_PX = 0.2  # how far the light may shift the middle on one side of the wall as a whole
SCALE_PX = 100.0  # keeps the normal equations well conditioned
PER_PX = np.array([[1, 1 / SCALE_PX], [1 / SCALE_PX, 1 / SCALE_PX**2]])
ASIDE = 0.03  # the same, as a share of the width
PRIOR = np.diag([1e-6, 1e-6, SIDE_PX**-2, SIDE_PX**-2, ASIDE**-2, ASIDE**-2])
BLURRED_PX = 2.4  # how wide the finest line looks through the lens and the slope filter
PULL = np.eye(6)[4]
UNSEEN_PX = -100.0
"""Width of a pair of edges that is not there."""

_TAPS = np.arange(-3, 4, dtype=np.float64)
_BELL = _TAPS * np.exp(-(_TAPS**2) / (2 * SIGMA_PX**2))
SLOPE = (_BELL / (_BELL * _TAPS).sum()).astype(np.float32)
MEAN = np.full(BLOCK_ROWS, 1 / BLOCK_ROWS, np.float32)
SLOPE_NOISE = float((SLOPE**2).sum())
CURVE_NOISE = float((np.diff(SLOPE, prepend=0, append=0) ** 2).sum())
COLUMNS = np.arange(200, dtype=np.float32)
MOMENTS = np.stack([np.ones(200, np.float32), COLUMNS], axis=1)
HALF_SPARE_PX = 4
SIGNS = np.array([0, 1])[:, None]


class Edges(Struct, frozen=True, eq=False):
    """Both edges of the shaft, block by block, as a pair that rises first and as one that falls first."""

    u_px: FloatImage
    """Middle of every block along the strip, (n,)."""
    middle_px: FloatImage
    """Half-way between them, across the strip from its middle, (2, n)."""
    variance_px2: FloatImage
    """Of that, (2, n)."""
    width_px: FloatImage
    """Between them, (2, n); UNSEEN_PX where there is no such pair."""
    steepness: FloatImage
    """Slope of the fainter one [grey levels per px], (2, n)."""
    is_outside: Mask
    """Blocks before the wall, (n,)."""


class Highlight(Struct, frozen=True):
    """How far a bright line on the metal runs beside its axis, as a share of that line's width."""

    share: float
    deviation: float


class LineFit(Struct, frozen=True, eq=False):
    """A straight line across a strip: v = offset_px + slope u."""

    offset_px: float
    slope: float
    covariance: NDArray[np.float64]
    """Of (offset_px, slope), (2, 2)."""
    width_px: float
    """Of the shaft, a median."""
    highlight: Highlight | None
    """None if no bright line within a darker shaft was ever seen."""
    u_px: FloatImage
    """Middle of every block along the strip, (n,)."""
    is_on_line: Mask
    """Blocks whose edges agree with the line, (n,)."""
    is_steep: Mask
    """Blocks with edges near the line that are steep enough to be the needle's and not its shadow's, (n,)."""

    @property
    def confidence(self) -> float:
        """Share of the blocks that show both edges on the line."""
        return float(self.is_on_line.mean())

    def end_px(self, from_px: float) -> float:
        """Return how far along the strip there are edges by the line; gaps count against it."""
        first = int(self.u_px.searchsorted(from_px))
        if first == len(self.u_px):
            return from_px + BLOCK_PX
        kept = (2 * self.is_steep[first:] - 1).cumsum()
        last = int(kept.argmax())
        return float(self.u_px[first + last]) + BLOCK_PX if kept[last] > 0 else from_px + BLOCK_PX

    def v_px(self, u_px: FloatImage) -> FloatImage:
        """Return the line's place across the strip."""
        return np.asarray(self.offset_px + self.slope * u_px, np.float32)


def fit_line(strip: Strip, tip_px: float, miss_px: float, highlight: Highlight | None = None) -> LineFit | None:
    """Fit the shaft's middle line to all visible rows before the tip.

    Args:
        strip: The straightened surroundings.
        tip_px: Where the needle ends, roughly.
        miss_px: How far the shaft may be from the strip's middle.
        highlight: Of this needle, where known from earlier images.

    Returns:
        The line, or None if too few blocks show two edges that lie on one.
    """
    last = max(math.floor((tip_px - float(strip.u_px[0])) / ROW_PX), 0)
    rows = np.concatenate([_block_rows(part, last) for part in (strip.before, strip.inside)])
    return _robust_line(_find_edges(strip, rows), miss_px, highlight) if len(rows) >= LEAST_BLOCKS else None


def _block_rows(part: slice, last: int) -> NDArray[np.int64]:
    """Return the middle rows of all whole blocks of a part before some row."""
    middle = BLOCK_ROWS // 2
    return np.arange(part.start + middle, min(part.stop, last) - (BLOCK_ROWS - 1 - middle), BLOCK_ROWS)


def _find_edges(strip: Strip, rows: NDArray[np.int64]) -> Edges:
    """Find, on either side of the strip's middle, the outermost edge of either sign."""
    noise = strip.noise_grey / math.sqrt(BLOCK_ROWS)
    rising = np.asarray(cv2.sepFilter2D(strip.excess, cv2.CV_32F, SLOPE, MEAN)[rows], np.float32)
    both = np.stack([rising, -rising])
    most = both.max(axis=2)
    least = np.maximum(FAINT * most.max(axis=0), STRONG * most)
    least = np.maximum(least, max(LEAST_SNR * noise * math.sqrt(SLOPE_NOISE), LEAST_SLOPE))
    about = _rough_middle(rising, strip.u_px[rows])
    inner = both[..., 1:-1]
    is_edge = (inner > both[..., 2:]) & (inner >= both[..., :-2]) & (inner >= least[..., None])
    is_edge &= np.abs(COLUMNS[: inner.shape[-1]] - about[:, None]) <= strip.half_px - HALF_SPARE_PX
    left = is_edge.argmax(axis=2)
    right = is_edge.shape[2] - 1 - is_edge[..., ::-1].argmax(axis=2)
    half = strip.half_px
    blocks = np.arange(len(rows))
    is_seen = is_edge[SIGNS, blocks, left] & (left < about)
    is_seen &= (is_edge[SIGNS, blocks, right] & (right > about))[::-1]
    left_px, left_curve, left_steep = _peaks(both, blocks, left)
    right_px, right_curve, right_steep = (values[::-1] for values in _peaks(both, blocks, right))
    floor_px2 = np.where(strip.is_known[rows], FLOOR_PX**2, UNKNOWN_FLOOR_PX**2)
    return Edges(
        strip.u_px[rows],
        middle_px=(left_px + right_px) / 2 - (half - 1),
        variance_px2=(CURVE_NOISE * noise**2 / 4) * (left_curve**-2 + right_curve**-2) + floor_px2,
        width_px=np.where(is_seen, right_px - left_px, UNSEEN_PX),
        steepness=np.minimum(left_steep, right_steep),
        is_outside=rows < strip.before.stop,
    )


def _rough_middle(rising: FloatImage, u_px: FloatImage) -> FloatImage:
    """Return where, between the second and the last column but one, the steep places lie in the mean, (n,)."""
    power = np.square(rising[:, 1:-1])
    sums = power @ MOMENTS[: power.shape[1]]
    middle = sums[:, 1] / np.maximum(sums[:, 0], 1e-6)
    dx, dy, x, y = cv2.fitLine(np.stack([u_px, middle], axis=1), cv2.DIST_HUBER, 0, 0.01, 0.01).ravel()
    return np.asarray(y + (u_px - x) * (dy / dx), np.float32) if abs(dx) > 0.5 else middle


def _peaks(
    both: FloatImage, blocks: NDArray[np.int64], columns: NDArray[np.int64]
) -> tuple[FloatImage, FloatImage, FloatImage]:
    """Return sub-pixel places, curvatures and heights of slope maxima, (2, n) each.

    The noise of a maximum's place is the noise of the derivative there over the curvature.
    """
    before, at, after = (both[SIGNS, blocks, columns + step] for step in range(3))
    curvature = np.maximum(2 * at - before - after, 1e-3)
    place = columns + (after - before) / (2 * curvature)
    return np.asarray(place, np.float32), curvature, at


def _missing(width: FloatImage) -> FloatImage:
    """Return by how much each pair is narrower than the shaft must be there [px]; infinite if it is too wide.

    Away from the tip it never gets narrower: a narrower place has lost an outer edge. A far wider one shows
    something else's. A width counts for others once two neighbours have it.
    """
    common = np.minimum(width[:, 1:], width[:, :-1])
    least = np.maximum.accumulate(common[:, ::-1], axis=1)[:, ::-1]
    missing = np.zeros_like(width)
    missing[:, :-2] = np.maximum(least[:, 1:] - NARROWER_PX - width[:, :-2], 0)
    most = np.maximum(common[:, :-1], common[:, 1:]) + WIDER_PX
    missing[:, 1:-1][width[:, 1:-1] > most] = np.inf
    return missing


def _robust_line(edges: Edges, miss_px: float, highlight: Highlight | None) -> LineFit | None:
    """Fit by weighted least squares, leaving out pairs that are off the line (Tukey's weights).

    What is known of the light comes in as further unknowns with priors. It differs on the two sides of the
    wall: each side as a whole may be off by SIDE_PX. A highlight runs beside the axis, the further the
    thicker the shaft: the middle of a pair may be off by a share of its width, a larger one where a bright
    pair was seen within a dark one.
    """
    count = len(edges.u_px)
    width = edges.width_px.ravel()
    seen = width > 0
    missing = _missing(edges.width_px)
    belief = (seen / (edges.variance_px2 + np.square(missing / 2)).ravel()).astype(np.float64)
    usable = belief > 0
    if int(usable.sum()) < LEAST_BLOCKS:
        return None
    design = np.zeros((6, 2, count))
    design[0], design[1], design[2], design[3] = 1, edges.u_px / SCALE_PX, edges.is_outside, ~edges.is_outside
    design[4, 0], design[5, 1] = np.maximum(edges.width_px - BLURRED_PX, 0)
    design = design.reshape(6, -1)
    highlight = highlight or _possible_highlight(edges, missing)
    prior, pull = PRIOR.copy(), 0.0
    if highlight:
        prior[4, 4] = highlight.deviation**-2
        pull = PULL * (prior[4, 4] * highlight.share)
    v = edges.middle_px.ravel()
    miss, reach = v, miss_px
    for number in range(ROUNDS):
        if number:
            miss = v - answer @ design
            reach = min(max(TUKEY * 1.4826 * median(np.abs(miss[usable])), LEAST_MISS_PX), MISS_PX)
        closeness = np.maximum(1 - np.square(miss / reach), 0)
        weighed = design * (belief * closeness * closeness)
        covariance = np.linalg.inv(weighed @ design.T + prior)
        answer = covariance @ (weighed @ v + pull)
    is_on = usable & (closeness > 0)
    on = is_on.reshape(2, -1)
    blocks_on = on[0] | on[1]
    number_on = int(blocks_on.sum())
    if number_on < LEAST_BLOCKS:
        return None
    miss = v - answer @ design
    scatter = max(float((belief * is_on) @ np.square(miss)) / max(int(is_on.sum()) - 2, 1), LEAST_SCATTER)
    steep = edges.steepness
    is_steep = seen.reshape(2, -1) & (np.abs(miss) <= NEAR_PX).reshape(2, -1)
    is_steep &= steep > LEAST_STEEP * median(steep[on])
    return LineFit(
        float(answer[0]),
        float(answer[1]) / SCALE_PX,
        covariance[:2, :2] * (scatter * PER_PX),
        median(width[is_on]),
        highlight
        and Highlight(float(answer[4]), math.hypot(math.sqrt(covariance[4, 4] * max(scatter, 1)), 0.01)),
        edges.u_px,
        blocks_on,
        is_steep[0] | is_steep[1],
    )


def _possible_highlight(edges: Edges, missing: FloatImage) -> Highlight | None:
    bright, dark = edges.width_px
    within = (bright > 0) & (dark > bright) & (missing[1] < NARROWER_PX)
    return Highlight(0.0, 0.6) if int(within.sum()) >= LEAST_BLOCKS else None
