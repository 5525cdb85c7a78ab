"""Where a point ends of which no clear fall of contrast tells.

Turns a strip and a reach into the tip's place along it, by what is sharp: the edges of metal are, however dim
it gets in the shade of the wall or for what it mirrors; a shadow that goes on beyond the point is not.
"""

import math

import numpy as np
from msgspec.structs import replace

from haptigraph.imaging import FloatImage
from haptigraph.perception.needle.coarse_tip import TipEstimate, core_contrast
from haptigraph.perception.needle.rectify import STATION_PX, RectifiedStrip, median
from haptigraph.perception.needle.sharpness import AROUND_PX, least_sharpness, mean_sharpness, sharpness
from haptigraph.perception.needle.subpixel_tip import FADING_LEVEL

__all__ = ["LONGEST_DIM_PX", "SHORTEST_DIM_PX", "dim_end_px", "goes_on", "is_plain_end", "sharp_end"]

GROUP = 4  # stations in which something sharp is looked for together
POINT = 5  # groups
SOFT_SHARE = 0.2  # a shadow is less sharp than this share of the point it goes on from
LEAST_SOFT = 6  # groups
BEYOND, BEHIND = 2, 8  # stations: from a fall of contrast on; before it, that tell how sharp a shaft is
UNBROKEN = 0.75  # share of the groups that must be sharp
SHARP_SD_PX = 1.0
STEADY, STEADY_BEHIND = 0.1, 20  # deviation of the contrast, as a share of it; stations that tell
BLURRED = 3  # stations, at a tip out of focus
MOST_SHADOW = 0.4  # contrast of a shadow, as a share of its shaft's
SHORTEST_DIM_PX, LONGEST_DIM_PX = 3, 14  # what is shorter is blurred
LEAST_DIM = 0.2  # share of the contrast behind
SHARP_SHARE = 0.3  # a dim point is sharper than this share of what is behind


def sharp_end(strip: RectifiedStrip, reach: TipEstimate) -> TipEstimate | None:
    """Find where the last sharp part of a shaft ends, if all that goes on from there is soft: its shadow.

    Args:
        strip: The straightened surroundings.
        reach: With a tip inside.

    Returns:
        The reach, or None if there is something sharp right before its tip, or nowhere.
    """
    start, start_px = strip.inside.start, float(strip.u_px[strip.inside.start])
    groups = int((reach.tip_px - start_px) / STATION_PX) + 2 - GROUP
    seen = strip.excess[:, start : start + groups + GROUP - 1]
    least = least_sharpness(strip.noise_grey, GROUP)
    if groups <= LEAST_SOFT or _is_sharp_to_end(seen, least):
        return None
    along = _along(strip, slice(start, start + groups + GROUP - 1))
    is_sharp = along >= max(least, SOFT_SHARE * median(along))
    pairs = (is_sharp[1:] & is_sharp[:-1]).nonzero()[0]
    end = int(pairs[-1]) + 1 if len(pairs) else groups
    if end > groups - LEAST_SOFT:
        return None
    high, low = median(along[max(end - POINT, 0) : end]), median(along[end + 2 :])
    if mean_sharpness(seen[:, end + GROUP :]) > SOFT_SHARE * high:
        return None
    level = max(min(low + FADING_LEVEL * (high - low), high), least)
    end = int((along[: end + 1] >= level).nonzero()[0][-1])
    share = (along[end] - level) / (along[end] - along[end + 1])
    tip_px = start_px + STATION_PX * (end + float(share) + (GROUP - 1) / 2)
    return replace(reach, tip_px=tip_px, sd_px=SHARP_SD_PX, contrast_grey=0.0)


def _is_sharp_to_end(seen: FloatImage, least: float) -> bool:
    """Tell whether the last stations are sharp, compared to those in the middle, and to noise."""
    middle = seen.shape[1] // 2
    usual, last = mean_sharpness(seen[:, middle : middle + GROUP]), mean_sharpness(seen[:, -GROUP:])
    return last >= max(SOFT_SHARE * usual, least)


def goes_on(strip: RectifiedStrip, from_px: float, to_px: float) -> bool:
    """Tell whether a shaft goes on from one place along a strip to another, as sharp as before.

    Args:
        strip: The straightened surroundings.
        from_px: Where it may end.
        to_px: How far something like it reaches.
    """
    end = int(strip.u_px.searchsorted(from_px))
    part = strip.inside if end >= strip.inside.start else strip.before
    start, stop = end + BEYOND, min(int(strip.u_px.searchsorted(to_px)), part.stop)
    if min(stop - start, end - part.start) < GROUP:
        return False
    behind = median(_along(strip, slice(max(end - BEHIND, part.start), end)))
    least = least_sharpness(strip.noise_grey, GROUP)
    is_sharp = _along(strip, slice(start, stop)) > max(least, SHARP_SHARE * behind)
    return int(np.count_nonzero(is_sharp)) >= UNBROKEN * len(is_sharp)


def is_plain_end(strip: RectifiedStrip, fall: TipEstimate, to_px: float) -> bool:
    """Tell whether a contrast that is the same all along a shaft falls to much less: that of its shadow.

    However sharp that is: out of focus a shaft is not much sharper. The contrast of what mirrors its
    surroundings is never the same for long.

    Args:
        strip: The straightened surroundings.
        fall: Where the shaft may end, inside.
        to_px: How far something like it reaches.
    """
    end = int(strip.u_px.searchsorted(fall.tip_px))
    behind = slice(max(end - BLURRED - STEADY_BEHIND, strip.inside.start), end - BLURRED)
    beyond = slice(end + BLURRED, int(strip.u_px.searchsorted(to_px)))
    if behind.stop - behind.start < STEADY_BEHIND // 2 or beyond.stop - beyond.start < 2:
        return False
    high, low = (core_contrast(strip, part)[0] for part in (behind, beyond))
    usual = median(high)
    return median(np.abs(high - usual)) < STEADY * usual and median(low) < MOST_SHADOW * usual


def dim_end_px(strip: RectifiedStrip, reach: TipEstimate) -> float | None:
    """Return where a point ends that gets dim before its end, and stays sharp.

    Args:
        strip: A close-up of the tip and what is beyond, the shaft in its middle.
        reach: Where the contrast falls.

    Returns:
        The place along the strip, to a pixel, or None if nothing sharp goes on from the fall.
    """
    start = math.ceil(reach.tip_px - float(strip.u_px[0])) + 1
    along, noise = core_contrast(strip, slice(start, strip.inside.stop))
    is_dim = along >= max(noise, LEAST_DIM * reach.contrast_grey)
    length = len(is_dim) if is_dim.all() else int(is_dim.argmin())
    if not SHORTEST_DIM_PX <= length <= LONGEST_DIM_PX:
        return None
    near = strip.excess[strip.half_px - AROUND_PX : strip.half_px + AROUND_PX + 1]
    parts = slice(max(start - 1 - length, 0), start - 1), slice(start, start + length)
    behind, dim = (mean_sharpness(near[:, part]) for part in parts)
    least = max(SHARP_SHARE * behind, least_sharpness(strip.noise_grey, length))
    return float(strip.u_px[start + length - 1]) if dim >= least else None


def _along(strip: RectifiedStrip, part: slice) -> FloatImage:
    """Return how sharp every group of stations is, (groups,) grey levels."""
    groups = part.stop - part.start - GROUP + 1
    starts = range(part.start, part.start + GROUP)
    sums = sum(strip.excess[:, start : start + groups] for start in starts)
    return sharpness(np.asarray(sums / GROUP, np.float32))
