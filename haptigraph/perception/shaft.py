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

from haptigraph.perception.pixels import FloatImage, Floats, Mask
from haptigraph.perception.strip import ROW_PX, Strip, median

__all__ = ["Edges", "Highlight", "LineFit", "fit_line"]

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
ASIDE = 0.03  # the same, as a share of the width
FIRST_SHARE, SHARE_CHANGE = 0.6, 0.01  # deviation of a highlight's share when first seen; added per image
FINEST_PX = 2.4  # how wide the finest line looks through the lens and the slope filter
SCALE_PX = 100.0  # keeps the normal equations well conditioned
PER_PX = np.array([[1, 1 / SCALE_PX], [1 / SCALE_PX, 1 / SCALE_PX**2]])
PRIOR = np.diag([1e-6, 1e-6, SIDE_PX**-2, SIDE_PX**-2, ASIDE**-2, ASIDE**-2])
UNSEEN_PX = -100.0
"""Width of a pair of edges that is not there."""

_TAPS = np.arange(-3, 4, dtype=np.float64)
_BELL = _TAPS * np.exp(-(_TAPS**2) / (2 * SIGMA_PX**2))
SLOPE = (_BELL / (_BELL * _TAPS).sum()).astype(np.float32)
MEAN = np.full(BLOCK_ROWS, 1 / BLOCK_ROWS, np.float32)
SLOPE_NOISE = float((SLOPE**2).sum())
CURVE_NOISE = float((np.diff(SLOPE, prepend=0, append=0) ** 2).sum())
SPARE_PX = 4  # of a strip's half width is not searched for edges
WIDEST = 1000  # columns that a strip may have
COLUMNS = np.arange(WIDEST, dtype=np.float32)
MOMENTS = np.stack([np.ones(WIDEST, np.float32), COLUMNS], axis=1)
SIGNS = np.array([0, 1])[:, None]


class Edges(Struct, frozen=True, eq=False):
    """Both edges of the shaft, block by block, as a pair that rises first and as one that falls first."""

    u_px: FloatImage
    """Middle of every block along the strip, (n,)."""
    middle_px: Floats
    """Half-way between them, across the strip from its middle, (2, n)."""
    variance_px2: Floats
    """Of that, (2, n)."""
    width_px: Floats
    """Between them, (2, n); UNSEEN_PX where there is no such pair."""
    steepness: Floats
    """Slope of the fainter one [grey levels per px], (2, n)."""
    is_outside: Mask
    """Blocks before the wall, (n,)."""


class Highlight(Struct, frozen=True):
    """How far a bright line on the metal runs beside its axis, as a share of that line's width."""

    share: float
    share_deviation: float


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


def fit_line(
    strip: Strip, tip_px: float, miss_px: float, highlight: Highlight | None = None
) -> LineFit | None:
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
    """Find the outermost edge of either sign on either side of where the steep places lie."""
    noise = strip.noise_grey / math.sqrt(BLOCK_ROWS)
    rising = np.asarray(cv2.sepFilter2D(strip.excess, cv2.CV_32F, SLOPE, MEAN)[rows], np.float32)
    both = np.stack([rising, -rising])
    most = both.max(axis=2)
    least = np.maximum(FAINT * most.max(axis=0), STRONG * most)
    least = np.maximum(least, max(LEAST_SNR * noise * math.sqrt(SLOPE_NOISE), LEAST_SLOPE))
    about = _rough_middle(rising, strip.u_px[rows])
    inner = both[..., 1:-1]  # columns from here on are those of `inner`, one less than the strip's
    is_edge = (inner > both[..., 2:]) & (inner >= both[..., :-2]) & (inner >= least[..., None])
    is_edge &= np.abs(COLUMNS[: inner.shape[2]] - about[:, None]) <= strip.half_px - SPARE_PX
    left, right = is_edge.argmax(axis=2), inner.shape[2] - 1 - is_edge[..., ::-1].argmax(axis=2)
    blocks = np.arange(len(rows))
    is_pair = is_edge[SIGNS, blocks, left] & (left < about)
    is_pair &= (is_edge[SIGNS, blocks, right] & (right > about))[::-1]
    left_px, left_curve, left_steep = _peaks(both, blocks, left)
    right_px, right_curve, right_steep = (values[::-1] for values in _peaks(both, blocks, right))
    floor_px2 = np.where(strip.is_known[rows], FLOOR_PX**2, UNKNOWN_FLOOR_PX**2)
    return Edges(
        strip.u_px[rows],
        middle_px=(left_px + right_px) / 2 - (strip.half_px - 1),
        variance_px2=(CURVE_NOISE * noise**2 / 4) * (left_curve**-2 + right_curve**-2) + floor_px2,
        width_px=np.where(is_pair, right_px - left_px, UNSEEN_PX),
        steepness=np.minimum(left_steep, right_steep),
        is_outside=rows < strip.before.stop,
    )


def _rough_middle(rising: FloatImage, u_px: FloatImage) -> Floats:
    """Return where, from the second column on, the steep places lie in the mean, (n,)."""
    power = np.square(rising[:, 1:-1])
    sums = power @ MOMENTS[: power.shape[1]]
    middle = sums[:, 1] / np.maximum(sums[:, 0], 1e-6)
    dx, dy, x, y = cv2.fitLine(np.stack([u_px, middle], axis=1), cv2.DIST_HUBER, 0, 0.01, 0.01).ravel()
    return np.asarray(y + (u_px - x) * (dy / dx) if abs(dx) > 0.5 else middle, np.float64)


def _peaks(
    both: FloatImage, blocks: NDArray[np.int64], columns: NDArray[np.int64]
) -> tuple[Floats, Floats, Floats]:
    """Return sub-pixel places, curvatures and heights of slope maxima, (2, n) each.

    The noise of a maximum's place is the noise of the derivative there over the curvature.
    """
    before, at, after = (both[SIGNS, blocks, columns + step].astype(np.float64) for step in range(3))
    curvature = np.maximum(2 * at - before - after, 1e-3)
    return columns + (after - before) / (2 * curvature), curvature, at


def _missing(width_px: Floats) -> Floats:
    """Return by how much each pair is narrower than the shaft must be there [px]; infinite if it is too wide.

    Away from the tip it never gets narrower: a narrower place has lost an outer edge. A far wider one shows
    something else's. A width counts for others once two neighbours have it.
    """
    common = np.minimum(width_px[:, 1:], width_px[:, :-1])
    least = np.maximum.accumulate(common[:, ::-1], axis=1)[:, ::-1]
    missing = np.zeros_like(width_px)
    missing[:, :-2] = np.maximum(least[:, 1:] - NARROWER_PX - width_px[:, :-2], 0)
    most = np.maximum(common[:, :-1], common[:, 1:]) + WIDER_PX
    missing[:, 1:-1][width_px[:, 1:-1] > most] = np.inf
    return missing


def _robust_line(edges: Edges, miss_px: float, highlight: Highlight | None) -> LineFit | None:
    """Fit by weighted least squares, leaving out pairs that are off the line (Tukey's weights).

    What is known of the light comes in as further unknowns with priors. It differs on the two sides of the
    wall: each side as a whole may be off by SIDE_PX. A highlight runs beside the axis, the further the
    thicker the shaft: the middle of a pair may be off by a share of its width, a larger one where a bright
    pair was seen within a dark one.
    """
    missing = _missing(edges.width_px)
    width = edges.width_px.ravel()
    is_seen = width > 0
    belief = is_seen / (edges.variance_px2 + np.square(missing / 2)).ravel()
    is_usable = belief > 0
    if int(is_usable.sum()) < LEAST_BLOCKS:
        return None
    highlight = highlight or _possible_highlight(edges, missing)
    prior, pull = PRIOR.copy(), np.zeros(6)
    if highlight:
        prior[4, 4] = highlight.share_deviation**-2
        pull[4] = prior[4, 4] * highlight.share
    design, v = _design(edges), edges.middle_px.ravel()
    answer, reach = np.zeros(6), miss_px
    for number in range(ROUNDS):
        miss = v - answer @ design
        if number:
            reach = min(max(TUKEY * 1.4826 * median(np.abs(miss[is_usable])), LEAST_MISS_PX), MISS_PX)
        closeness = np.maximum(1 - np.square(miss / reach), 0)
        weighed = design * (belief * closeness * closeness)
        covariance = np.linalg.inv(weighed @ design.T + prior)
        answer = covariance @ (weighed @ v + pull)
    is_on = is_usable & (closeness > 0)
    miss = v - answer @ design
    scatter = float((belief * is_on) @ np.square(miss)) / max(int(is_on.sum()) - 2, 1)
    is_on_line = is_on.reshape(2, -1).any(axis=0)
    if int(is_on_line.sum()) < LEAST_BLOCKS:
        return None
    steepness = edges.steepness.ravel()
    is_steep = is_seen & (np.abs(miss) <= NEAR_PX) & (steepness > LEAST_STEEP * median(steepness[is_on]))
    deviation_ratio = math.sqrt(covariance[4, 4] * max(scatter, 1))
    return LineFit(
        float(answer[0]),
        float(answer[1]) / SCALE_PX,
        covariance[:2, :2] * (max(scatter, LEAST_SCATTER) * PER_PX),
        median(width[is_on]),
        highlight and Highlight(float(answer[4]), math.hypot(deviation_ratio, SHARE_CHANGE)),
        edges.u_px,
        is_on_line,
        np.asarray(is_steep.reshape(2, -1).any(axis=0)),
    )


def _design(edges: Edges) -> Floats:
    """Return what each unknown does to the middle of every pair, (6, 2 n).

    They are place and slope of the line, a shift on either side of the wall, and a shift by the width of
    bright and of dark pairs.
    """
    design = np.zeros((6, *edges.width_px.shape))
    design[0], design[1], design[2], design[3] = 1, edges.u_px / SCALE_PX, edges.is_outside, ~edges.is_outside
    design[4, 0], design[5, 1] = np.maximum(edges.width_px - FINEST_PX, 0)
    return design.reshape(6, -1)


def _possible_highlight(edges: Edges, missing: Floats) -> Highlight | None:
    """Return how little is known of a highlight when one is first seen: bright pairs within dark ones."""
    bright, dark = edges.width_px
    within = (bright > 0) & (dark > bright) & (missing[1] < NARROWER_PX)
    return Highlight(0.0, FIRST_SHARE) if int(within.sum()) >= LEAST_BLOCKS else None
