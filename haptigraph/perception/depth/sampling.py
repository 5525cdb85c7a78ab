"""Sample image and depth along a shaft that is known in the image.

Turns both into blocks along the shaft: its half-width in the image, and one over the depth of its surface.
"""

import cv2
import numpy as np
from msgspec import Struct
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats, Mask, grey_of, peak_offset
from haptigraph.messages import DepthImage, Image

__all__ = ["BLOCK_PX", "Blocks", "sample"]

BLOCK_PX = 6
"""Length of a block: farther apart, the matching window of a stereo camera sees other pixels."""
LANE_PX = 0.5
CORE_SHARE = 0.5  # of the half-width, about the axis, in which depths count
MIN_HALF_PX = 1.5  # of a thinner shaft all depths are partly the background's
MIN_DEPTHS = 4  # of a block
OUTLIER_SPREADS, MIN_SPREAD_MM = 3.0, 0.15  # of a depth from the median of its block
OUTER_SHARE = 0.3  # of the steepest edge: a highlight within the shaft has steeper ones
SMOOTH_BLOCKS = 2  # to either side, over which the median of half-widths is taken


class Blocks(Struct, frozen=True, eq=False):
    """Blocks along a shaft; those without depth are left out."""

    along_px: Floats
    """Middle of each, from the first point towards the second, (n,)."""
    half_px: Floats
    """Half-width of the shaft in the image, (n,)."""
    inverse_per_mm: Floats
    """One over the depth of its visible surface, (n,)."""


def sample(
    image: Image,
    depth: DepthImage,
    ends_px: tuple[Vec, Vec],
    max_half_px: float,
    hidden: Mask,
    half_px: Floats | None = None,
) -> Blocks:
    """Sample along the line between two points of the image as stored [px].

    Args:
        image: (h, w, 3) BGR or (h, w) grey.
        depth: Of the same pixels.
        ends_px: The points.
        max_half_px: Half the width of the thickest shaft.
        hidden: Whether the shaft is hidden, in the wall for instance, at each pixel of length, (n,).
        half_px: Half-width of the shaft there, (n,); None: it is measured in the image, towards the tip.
    """
    start, end = ends_px
    count = len(hidden) // BLOCK_PX
    stations = np.arange(count * BLOCK_PX) + 0.5
    lanes = np.arange(-2 * max_half_px - 2, 2 * max_half_px + 2 + LANE_PX, LANE_PX)
    length_px = max(float(np.hypot(end[0] - start[0], end[1] - start[1])), 1e-9)
    along = (end[0] - start[0]) / length_px, (end[1] - start[1]) / length_px
    x = start[0] + stations * along[0] - lanes[:, None] * along[1]
    y = start[1] + stations * along[1] + lanes[:, None] * along[0]
    if half_px is None:
        half_px = _half_widths(_sampled(grey_of(image), x, y, cv2.INTER_LINEAR), lanes, count, max_half_px)
        is_visible = ~hidden[: len(stations)].reshape(count, BLOCK_PX).all(axis=1)
        half_px[is_visible] = _decreasing(half_px[is_visible])
    else:
        half_px = np.asarray(half_px[: len(stations)].reshape(count, BLOCK_PX).mean(axis=1), np.float64)
    values = _sampled(depth.values, x - depth.left_px, y - depth.top_px, cv2.INTER_NEAREST)
    is_core = np.abs(lanes)[:, None] <= np.maximum(CORE_SHARE * np.repeat(half_px, BLOCK_PX), LANE_PX)
    counts = is_core & (values > 0) & ~hidden[: len(stations)]
    inverse = _inverse_depths(counts, values * depth.unit_mm, count)
    is_used = np.isfinite(inverse) & (half_px >= MIN_HALF_PX)
    middle = np.asarray((np.arange(count) + 0.5) * BLOCK_PX, np.float64)
    return Blocks(middle[is_used], half_px[is_used], inverse[is_used])


def _sampled(values: NDArray[np.uint8 | np.uint16], x: Floats, y: Floats, how: int) -> Floats:
    maps = np.asarray(x, np.float32), np.asarray(y, np.float32)
    return np.asarray(cv2.remap(values, *maps, how, borderMode=cv2.BORDER_CONSTANT), np.float64)


def _half_widths(grey: Floats, lanes: Floats, count: int, max_half_px: float) -> Floats:
    """Return the half-width of the shaft in each block, (count,): between the outermost steep edges."""
    profiles = grey.reshape(len(lanes), count, BLOCK_PX).mean(axis=2)
    slopes = np.abs(np.gradient(profiles, axis=0))
    half = np.zeros((2, count))
    for side, sign in enumerate((-1, 1)):
        is_side = (sign * lanes > 0) & (np.abs(lanes) <= max_half_px + 1)
        steep = np.where(is_side[:, None], slopes, 0.0)
        is_peak = np.zeros(steep.shape, np.bool_)
        is_peak[1:-1] = (steep[1:-1] >= steep[:-2]) & (steep[1:-1] >= steep[2:])
        is_peak &= (steep >= OUTER_SHARE * steep.max(axis=0)) & (steep > 0)
        outer = np.where(is_peak, np.abs(lanes)[:, None], 0).argmax(axis=0)
        at, blocks = np.clip(outer, 1, len(lanes) - 2), np.arange(count)
        offset = peak_offset(slopes[at - 1, blocks], slopes[at, blocks], slopes[at + 1, blocks])
        half[side] = sign * (lanes[at] + LANE_PX * offset)
    widths = np.pad(half.mean(axis=0), SMOOTH_BLOCKS, mode="edge")
    return np.asarray(np.median(sliding_window_view(widths, 2 * SMOOTH_BLOCKS + 1), axis=1), np.float64)


def _decreasing(values: Floats) -> Floats:
    """Return the nearest values that nowhere increase, (n,): isotonic regression, by its minimax formula.

    A shaft is nowhere thinner than nearer to its tip; where it appears so, both are in error.
    """
    count = len(values)
    sums, at = np.concatenate([[0.0], np.cumsum(values)]), np.arange(count)
    lengths = at[None, :] - at[:, None] + 1
    means = np.where(lengths > 0, sums[None, 1:] - sums[:-1, None], -np.inf) / np.maximum(lengths, 1)
    highest = np.maximum.accumulate(means[:, ::-1], axis=1)[:, ::-1]
    return np.asarray(np.minimum.accumulate(highest, axis=0).diagonal(), np.float64)


def _inverse_depths(counts: Mask, depth_mm: Floats, count: int) -> Floats:
    """Return one over the mean depth of each block, (count,); nan where too few pixels have one."""
    blocks = np.where(counts, depth_mm, np.nan).reshape(len(counts), count, BLOCK_PX)
    found = blocks.transpose(1, 0, 2).reshape(count, -1)
    inverse, is_seen = np.full(count, np.nan), np.isfinite(found).sum(axis=1) >= MIN_DEPTHS
    if is_seen.any():
        seen = found[is_seen]
        off_mm = np.abs(seen - np.nanmedian(seen, axis=1, keepdims=True))
        seen[off_mm > OUTLIER_SPREADS * np.nanmedian(off_mm, axis=1, keepdims=True) + MIN_SPREAD_MM] = np.nan
        inverse[is_seen] = 1 / np.nanmean(seen, axis=1)
    return inverse
