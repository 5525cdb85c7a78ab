"""The shaft's middle line: where the middles of its edges lie, weighed by how sure they are.

Turns the edges in a strip into a line with its covariance. Knows no trocar and no time.
"""

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.perception.pixels import FloatImage, Floats, Mask
from haptigraph.perception.robust_line import FROM_COMMON_PX, off_common_line, solved
from haptigraph.perception.shaft_edges import (
    BLOCK,
    BLOCK_PX,
    LEAST_BLOCKS,
    NOISY_GREY,
    Edges,
    at_feet,
    find_edges,
)
from haptigraph.perception.strip import Strip, median

__all__ = ["NEW", "Highlight", "LineFit", "Look", "fit_line"]

CLEAR_CONFIDENCE = 0.6  # with less in noise,
LONG_BLOCK = 3 * BLOCK  # so many stations are looked at together
LEAST_SCATTER = 0.05  # of residuals over expected deviations, squared
NEAR_PX = 3.0
LEAST_STEEP = 0.25  # of the shaft's edges: softer ones are its shadow's
NARROWER_PX = 1.2
WIDER_PX = 3.0
MESSY = 3.0  # scatter: the line may run between two things
SURPRISING_PX = 3.0  # off where it was expected: it may run along something else
SIDE_PX = 0.2  # how far the light may shift the middle on one side of the wall as a whole
BRIGHT_ASIDE, DARK_ASIDE = 0.03, 0.015  # the same, as a share of a pair's width
LEAST_LEAN_PX2 = 0.25  # how much blurrier one edge may be than the other in the same light
LEAN_RATE, MOST_LEAN_PX = 0.35, 0.35  # shift of the middle away from an edge that fades, per px2; at most
SHADE_RATE = 0.1  # of what one image tells of that shift
FIRST_SHARE, SHARE_CHANGE = 0.6, 0.01  # deviation of a highlight's share when first seen; added per image
FINEST_PX = 2.4  # how wide the finest line looks through the lens and the slope filter
RETRY_IMAGES = 8  # after so many without feet they are tried as seldom
BETTER, WORSE, FARTHER_OUT_PX = 0.5, 2.0, 1.5  # scatter by feet, over that by slopes
NOISY = 0.2  # scatter that noise alone makes
LEAST_SHARE = 0.75  # of the blocks on the line
SCALE_PX = 100.0  # keeps the normal equations well conditioned
PRIOR = np.diag([1e-6, 1e-6, SIDE_PX**-2, SIDE_PX**-2, BRIGHT_ASIDE**-2, DARK_ASIDE**-2])


class Highlight(Struct, frozen=True):
    """How far a bright line on the metal runs beside its axis, as a share of that line's width."""

    share: float
    share_deviation: float


class Look(Struct, frozen=True):
    """What earlier images told of how a needle looks."""

    highlight: Highlight | None = None
    """None if no bright line within a darker shaft was ever seen."""
    images: int = 0
    """Since edges lay on a line better by their feet, or the needle came."""
    shaded_px: tuple[float | None, float | None] = (None, None)
    """How far off the middle is before the wall and inside, for one edge fades; None if never told."""


NEW = Look()
"""Of a needle that has just come."""


class LineFit(Struct, frozen=True, eq=False):
    """A straight line across a strip: v = offset_px + slope u."""

    offset_px: float
    slope: float
    covariance: tuple[float, float, float]
    """Of (offset_px, offset_px), (offset_px, slope) and (slope, slope)."""
    width_px: float
    """Of the shaft, a median."""
    blur_px: float
    """Deviation of the blur across its edges, a median: of the lens, and of how round metal is lit."""
    look: Look
    scatter: float
    """Of residuals over expected deviations, squared."""
    u_px: FloatImage
    """Middle of every block along the strip, (n,)."""
    is_on_line: Mask
    """Blocks whose edges agree with the line, (n,)."""
    is_steep: Mask
    """Blocks with edges near the line that are steep enough to be the needle's and not its shadow's, (n,)."""

    @property
    def confidence(self) -> float:
        """Share of the blocks that show both edges on the line."""
        return int(np.count_nonzero(self.is_on_line)) / len(self.is_on_line)

    @property
    def most_off_px(self) -> float:
        """How far the line leaves the strip's middle, at either end of what was looked at."""
        return max(abs(self.offset_px + self.slope * float(u_px)) for u_px in self.u_px[[0, -1]])

    def leads_through(self, wall_px: float) -> bool:
        """Tell whether edges lie by the line right before the wall, or enough of them beyond it."""
        beyond = int(self.u_px.searchsorted(wall_px))
        before = self.is_steep[max(beyond - LEAST_BLOCKS, 0) : beyond]
        return (
            int(np.count_nonzero(before)) >= 2
            or int(np.count_nonzero(self.is_steep[beyond:])) >= LEAST_BLOCKS
        )

    def end_px(self, from_px: float) -> float:
        """Return how far along the strip there are edges by the line: the end of the last unbroken run."""
        first = int(self.u_px.searchsorted(from_px))
        is_steep = self.is_steep[first:]
        runs = is_steep[2:] & is_steep[1:-1] & is_steep[:-2]
        ends = runs.nonzero()[0]
        return float(self.u_px[first + ends[-1] + 2]) + BLOCK_PX if len(ends) else from_px + BLOCK_PX


def fit_line(strip: Strip, tip_px: float, miss_px: float, look: Look = NEW) -> LineFit | None:
    """Fit the shaft's middle line to all that is visible of it before the tip.

    Args:
        strip: The straightened surroundings.
        tip_px: Where the needle ends, roughly.
        miss_px: How far the shaft may be from the strip's middle.
        look: What earlier images told of this needle.

    Returns:
        The line, or None if too few blocks show two edges that lie on one.
    """
    fit = _fit_line(strip, tip_px, miss_px, look, BLOCK)
    if strip.noise_grey > NOISY_GREY and (fit is None or fit.confidence < CLEAR_CONFIDENCE):
        fits = fit, _fit_line(strip, tip_px, miss_px, look, LONG_BLOCK)
        return max(filter(None, fits), key=lambda fit: fit.confidence, default=None)
    return fit


def _fit_line(strip: Strip, tip_px: float, miss_px: float, look: Look, block: int) -> LineFit | None:
    edges = find_edges(strip, tip_px, block)
    if edges is None:
        return None
    outside_px, inside_px = look.shaded_px
    outside_px = _shaded_px(edges, slice(0, edges.outside), outside_px)
    inside_px = _shaded_px(edges, slice(edges.outside, None), inside_px)
    look = replace(look, shaded_px=(outside_px, inside_px))
    fit = _robust_line(edges, miss_px, look)
    if look.images < RETRY_IMAGES or look.images % RETRY_IMAGES == 0:
        feet = at_feet(edges)
        by_feet = _robust_line(feet, miss_px, look, are_feet=True) if feet else None
        if feet and by_feet and (fit is None or _is_better(by_feet, fit)):
            return _checked(by_feet, feet, miss_px, look, are_feet=True)
    return fit and _checked(fit, edges, miss_px, look)


def _checked(fit: LineFit, edges: Edges, miss_px: float, look: Look, are_feet: bool = False) -> LineFit:
    """Return a line, or the one that most pairs are on where it may run along something else."""
    is_messy = fit.scatter > MESSY
    if is_messy or fit.most_off_px > SURPRISING_PX:
        common = _robust_line(edges, miss_px, look, are_feet, is_messy=True)
        if common and (is_messy or (common.confidence, fit.scatter) > (fit.confidence, common.scatter)):
            return common
    return fit


def _is_better(feet: LineFit, slopes: LineFit) -> bool:
    """Tell whether feet lie on one line better than the steepest places do.

    If they are further out they may do so worse: then the steepest places are a highlight's. If not, they
    must do so much better, and noise alone must not explain it.
    """
    is_wider = feet.width_px > slopes.width_px + FARTHER_OUT_PX
    on_line, others = (int(np.count_nonzero(fit.is_on_line)) for fit in (feet, slopes))
    if on_line < LEAST_SHARE * others:
        return False
    if is_wider:
        return feet.scatter < WORSE * slopes.scatter
    return slopes.scatter > NOISY and feet.scatter < BETTER * slopes.scatter


def _missing(width_px: Floats) -> Floats:
    """Return by how much each pair is narrower than the shaft must be there [px]; infinite if it is too wide.

    Away from the tip it never gets narrower: a narrower place has lost an outer edge, and so has a dark pair
    within a bright one. A far wider one shows something else's. A width counts for others once two neighbours
    have it.
    """
    common = np.minimum(width_px[:, 1:], width_px[:, :-1])
    least = np.maximum.accumulate(common[:, ::-1], axis=1)[:, ::-1]
    missing = np.zeros_like(width_px)
    np.maximum(least[:, 1:] - NARROWER_PX - width_px[:, :-2], 0, out=missing[:, :-2])
    most = np.maximum(common[:, :-1], common[:, 1:]) + WIDER_PX
    missing[1] = np.maximum(missing[1], np.where(width_px[1] > 0, width_px[0] - width_px[1], 0))
    missing[:, 1:-1][width_px[:, 1:-1] > most] = np.inf
    return missing


def _robust_line(
    edges: Edges, miss_px: float, look: Look, are_feet: bool = False, is_messy: bool = False
) -> LineFit | None:
    """Fit the line by what pairs can be trusted.

    What is known of the light comes in as further unknowns with priors. It differs on the two sides of the
    wall: each side as a whole may be off by SIDE_PX, and is where one edge fades into the shade. A highlight
    runs beside the axis, the further the thicker the shaft: the middle of a pair may be off by a share of its
    width, a larger one where a bright pair was seen within a dark one. Where feet tell, there is none.

    Args:
        edges: Both edges, block by block.
        miss_px: How far the shaft may be from the strip's middle.
        look: What earlier images told of this needle.
        are_feet: Whether the edges are where feet say.
        is_messy: Whether to begin with the line that most pairs are on.
    """
    missing = _missing(edges.width_px)
    has_pair = edges.width_px > 0
    trust = (has_pair / (edges.variance_px2 + np.square(missing / 2))).ravel()
    usable = trust.nonzero()[0]
    if len(usable) < LEAST_BLOCKS:
        return None
    highlight = None
    if not are_feet:
        highlight = look.highlight or _possible_highlight(edges.width_px, missing)
    light = _light(look.shaded_px, highlight)
    design, v = _design(edges), edges.middle_px.ravel()
    off_px, reach_px = v, miss_px
    if is_messy:
        off_px, reach_px = off_common_line(np.tile(edges.u_px, 2), v, usable), FROM_COMMON_PX
    answer, covariance, is_on, miss, scatter = solved(design, v, trust, usable, light, off_px, reach_px)
    is_on_line = _has_one(is_on)
    if np.count_nonzero(is_on_line) < LEAST_BLOCKS:
        return None
    steepness = edges.steepness.ravel()
    least = LEAST_STEEP * _usual_steepness(edges, is_on)
    is_steep = (np.abs(miss) <= NEAR_PX) & (steepness > least) & (trust > 0)
    share_deviation = math.sqrt(covariance[4, 4] * max(scatter, 1))
    (offset_px2, both), (_, slope2) = covariance[:2, :2].tolist()
    spread = max(scatter, LEAST_SCATTER)
    return LineFit(
        float(answer[0]),
        float(answer[1]) / SCALE_PX,
        (spread * offset_px2, spread * both / SCALE_PX, spread * slope2 / SCALE_PX**2),
        median(edges.width_px.ravel()[is_on]),
        edges.usual_blur_px(is_on),
        Look(
            highlight and Highlight(float(answer[4]), math.hypot(share_deviation, SHARE_CHANGE)),
            0 if are_feet else look.images + 1,
            look.shaded_px,
        ),
        scatter,
        edges.u_px,
        is_on_line,
        _has_one(is_steep),
    )


def _usual_steepness(edges: Edges, is_on: Mask) -> Floats:
    """Return how steep edges on the line usually are where each pair lies, (2 n,).

    Within the globe the ground may be nearly as bright as the needle: there they may be less steep.
    """
    inside = np.tile(np.arange(len(edges.u_px)) >= edges.outside, 2)
    steepness = edges.steepness.ravel()
    usual = np.full(len(steepness), median(steepness[is_on]))
    inner = steepness[is_on & inside]
    if len(inner) >= LEAST_BLOCKS:
        usual[inside] = min(median(inner), usual[0])
    return usual


def _has_one(is_pair: Mask) -> Mask:
    """Return which blocks have one of some pairs, (n,)."""
    middle = len(is_pair) // 2
    return np.asarray(is_pair[:middle] | is_pair[middle:], np.bool_)


def _light(
    shaded_px: tuple[float | None, float | None], highlight: Highlight | None
) -> tuple[Floats, Floats]:
    """Return what is known of the unknowns before: one over variances, (6, 6); that times them, (6,)."""
    prior, pull = PRIOR.copy(), np.zeros(6)
    pull[2:4] = [SIDE_PX**-2 * (px or 0.0) for px in shaded_px]
    if highlight:
        prior[4, 4] = highlight.share_deviation**-2
        pull[4] = prior[4, 4] * highlight.share
    return prior, pull


def _design(edges: Edges) -> Floats:
    """Return what each unknown does to the middle of every pair, (6, 2 n).

    They are place and slope of the line, a shift on either side of the wall, and a shift by the width of
    bright and of dark pairs.
    """
    design = np.zeros((6, *edges.width_px.shape))
    design[0] = 1
    design[1] = edges.u_px * (1 / SCALE_PX)
    design[2, :, : edges.outside] = 1
    design[3, :, edges.outside :] = 1
    aside = np.maximum(edges.width_px - FINEST_PX, 0)
    design[4, 0], design[5, 1] = aside
    return design.reshape(6, -1)


def _shaded_px(edges: Edges, side: slice, before_px: float | None) -> float | None:
    """Return how far off the middle is on one side of the wall, for one edge fades into the shade.

    That edge is blurrier, and found where it begins to fade: the axis lies nearer to it. Beside a dark shaft
    an edge may be blurred by the shaft's shadow just as well. One image tells it badly.
    """
    is_bright, is_dark = edges.width_px[:, side] > 0
    bright, dark = int(np.count_nonzero(is_bright)), int(np.count_nonzero(is_dark))
    if max(bright, dark) < LEAST_BLOCKS:
        return before_px
    lean = 0.0
    if bright >= dark:
        left_px2, right_px2 = (blur[0, side][is_bright] for blur in edges.blurs_px2)
        lean = median(right_px2 - left_px2)
    shift_px = min(LEAN_RATE * max(abs(lean) - LEAST_LEAN_PX2, 0.0), MOST_LEAN_PX)
    now_px = -math.copysign(shift_px, lean)
    return now_px if before_px is None else before_px + SHADE_RATE * (now_px - before_px)


def _possible_highlight(width_px: Floats, missing: Floats) -> Highlight | None:
    """Return how little is known of a highlight when one is first seen: bright pairs within dark ones."""
    bright, dark = width_px
    within = (bright > 0) & (dark > bright) & (missing[1] < NARROWER_PX)
    return Highlight(0.0, FIRST_SHARE) if np.count_nonzero(within) >= LEAST_BLOCKS else None
