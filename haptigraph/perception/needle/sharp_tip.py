"""The end of a point without a clear contrast step.

Turns a rectified strip and an approximate tip into the tip's position along it, by sharpness: the edges of
metal are sharp, however dim it gets in the shade of the wall or by what it mirrors; a shadow that continues
beyond the point is not.
"""

import math

import numpy as np
from msgspec.structs import replace

from haptigraph.imaging import FloatImage
from haptigraph.perception.native.sharpness import AROUND_PX, mean_sharpness, sharpness, sharpness_threshold
from haptigraph.perception.native.strip import core_contrast
from haptigraph.perception.needle.coarse_tip import TipEstimate
from haptigraph.perception.needle.rectify import STATION_PX, RectifiedStrip, median
from haptigraph.perception.needle.subpixel_tip import FADING_LEVEL

__all__ = ["continues", "is_bright", "is_clear_end", "sharp_end"]

GROUP = 4  # stations whose sharpness is measured together
POINT = 5  # groups
SOFT_SHARE = 0.2  # a shadow is less sharp than this share of the point it continues
MIN_SOFT = 6  # groups
BEHIND = 8  # stations before a contrast step, for the shaft's usual sharpness
UNBROKEN = 0.75  # share of the groups that must be sharp
SHARP_SD_PX = 1.0
STEADY, STEADY_BEHIND = 0.1, 20  # variation of the contrast, as a share of it; stations behind the step
MIN_SNR = 4.0  # of the brightest lane
BLURRED = 3  # stations, at a tip out of focus
MAX_SHADOW = 0.4  # contrast of a shadow, as a share of its shaft's
SHARP_SHARE = 0.3  # of what is behind: what is less sharp is no shaft


def sharp_end(strip: RectifiedStrip, tip: TipEstimate) -> TipEstimate | None:
    """Find the end of the last sharp part of a shaft, if all that continues from there is soft: its shadow.

    Args:
        strip: The strip.
        tip: Inside the globe.

    Returns:
        The tip, or None if there is something sharp right before it, or nowhere.
    """
    start, start_px = strip.inside.start, strip.inner_px
    shown = len(strip.u_px) - start  # a tip may be refined to right beyond the strip
    groups = min(int((tip.u_px - start_px) / STATION_PX) + 1, shown) + 1 - GROUP
    excess = strip.excess[:, start : start + groups + GROUP - 1]
    threshold = sharpness_threshold(strip.noise_grey, GROUP)
    if groups <= MIN_SOFT or _is_sharp_to_end(excess, threshold):
        return None
    along = _along(strip, slice(start, start + groups + GROUP - 1))
    is_sharp = along >= max(threshold, SOFT_SHARE * median(along))
    pairs = (is_sharp[1:] & is_sharp[:-1]).nonzero()[0]
    end = int(pairs[-1]) + 1 if len(pairs) else groups
    if end > groups - MIN_SOFT:
        return None
    high, low = median(along[max(end - POINT, 0) : end]), median(along[end + 2 :])
    if mean_sharpness(excess[:, end + GROUP :]) > SOFT_SHARE * high:
        return None
    level = max(min(low + FADING_LEVEL * (high - low), high), threshold)
    end = int((along[: end + 1] >= level).nonzero()[0][-1])
    share = (along[end] - level) / (along[end] - along[end + 1])
    u_px = start_px + STATION_PX * (end + float(share) + (GROUP - 1) / 2)
    behind_grey = median(core_contrast(strip, slice(start + max(end - POINT, 0), start + end))[0])
    return replace(tip, u_px=u_px, sd_px=SHARP_SD_PX, contrast_grey=behind_grey)


def _is_sharp_to_end(excess: FloatImage, threshold: float) -> bool:
    """Return whether the last stations are sharp, compared to those in the middle, and to noise."""
    middle = excess.shape[1] // 2
    usual, last = mean_sharpness(excess[:, middle : middle + GROUP]), mean_sharpness(excess[:, -GROUP:])
    return last >= max(SOFT_SHARE * usual, threshold)


def continues(strip: RectifiedStrip, from_px: float, to_px: float) -> bool:
    """Return whether a shaft continues from one position along a strip to another, as sharp as before.

    Args:
        strip: The strip.
        from_px: Where it may end.
        to_px: How far there is contrast.
    """
    end = int(strip.u_px.searchsorted(from_px))
    part = strip.inside if end >= strip.inside.start else strip.outside
    start, stop = end, min(int(strip.u_px.searchsorted(to_px)), part.stop)
    if min(stop - start, end - part.start) < GROUP:
        return False
    behind = median(_along(strip, slice(max(end - BEHIND, part.start), end)))
    threshold = sharpness_threshold(strip.noise_grey, GROUP)
    is_sharp = _along(strip, slice(start, stop)) > max(threshold, SHARP_SHARE * behind)
    return int(np.count_nonzero(is_sharp)) >= UNBROKEN * len(is_sharp)


def is_clear_end(strip: RectifiedStrip, tip: TipEstimate, to_px: float) -> bool:
    """Return whether a contrast that is even along the shaft falls to much less: that of its shadow.

    Sharpness does not count: out of focus a shaft is not much sharper than its shadow. The contrast of metal
    that mirrors its surroundings is never even for long.

    Args:
        strip: The strip.
        tip: Where the shaft may end, inside the globe.
        to_px: How far there is contrast.
    """
    end = int(strip.u_px.searchsorted(tip.u_px))
    behind = slice(max(end - BLURRED - STEADY_BEHIND, strip.inside.start), end - BLURRED)
    beyond = slice(end + BLURRED, int(strip.u_px.searchsorted(to_px)))
    if behind.stop - behind.start < STEADY_BEHIND // 2 or beyond.stop - beyond.start < 2:
        return False
    high, low = (core_contrast(strip, part)[0] for part in (behind, beyond))
    usual = median(high)
    return median(np.abs(high - usual)) < STEADY * usual and median(low) < MAX_SHADOW * usual


def is_bright(strip: RectifiedStrip, from_px: float, to_px: float) -> bool:
    """Return whether a lane in the middle of a strip is brighter than its ground, as no shadow is."""
    start, stop = (int(strip.u_px.searchsorted(px)) for px in (from_px, to_px))
    middle = strip.excess[strip.half_px - AROUND_PX : strip.half_px + AROUND_PX + 1, start:stop]
    return stop > start and float(middle.mean(axis=1).max()) > MIN_SNR * strip.noise_grey / math.sqrt(
        stop - start
    )


def _along(strip: RectifiedStrip, part: slice) -> FloatImage:
    """Return how sharp each group of stations is, (groups,) grey levels."""
    return sharpness(strip.excess[:, part], GROUP)
