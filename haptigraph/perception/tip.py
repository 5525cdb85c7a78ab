"""How far the needle reaches: the tip as the step from needle to no needle along the shaft.

Turns a strip and the shaft's line into the tip's place along it. Evidence is summed from where the needle
comes from, so that a gap (glare, debris) is bridged and a thing beyond a long gap is not the needle.
Nothing behind the wall can be seen: a needle whose tip is in there has none.
"""

import math
from typing import Literal

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.perception.pixels import FloatImage, Mask
from haptigraph.perception.strip import STATION_PX, Strip

__all__ = [
    "FADING_LEVEL",
    "LEAST_SNR",
    "Reach",
    "closeup_px",
    "core_contrast",
    "find_reach",
    "is_led_to",
    "refine_tip",
]

CORE = np.full(5, 1 / 5, np.float32)  # lanes in the middle of a strip
LEAST_GREY = 5.0
UNKNOWN_GREY = 8.0
LEAST_SNR = 4.0
KNOWN_SHARE = 0.1  # of the contrast that the needle had before
UNKNOWN_SHARE = 0.35
BEHIND_PX, AHEAD_PX = 12, 10  # how much of the needle, and of what follows, tells where it ends
NEAR_PX, BLUNT_PX = 7, 2
TIP_LEVEL = 0.36  # between beyond and behind: the point is thin and rounded, half is seen too early
FADING_LEVEL = 0.3  # of dark rims about a bright middle: where they are thin, blur takes one from the other
ONE_TONE = 0.8  # share of the contrast that is of one sign, below which a point fades like that
SHARP_FALL_PX, LONGEST_FALL_PX = 2.5, 7.5  # of a point in focus, and of one far out of it
BLUR_SHARE = 0.08  # of a longer fall: blur takes the level beyond the point
LEAST_FALL = 0.6  # what is beyond has less than this share of the contrast behind
UNKNOWN_FALL = 0.4  # the same before a wall that was never seen without a needle
BEYOND_PX = 4  # the blurred end of the tip
WALL_PX = 2  # of the wall's edge
FLOOR_PX, FLOOR_GREY = 0.1, 1e-3
LEAST_HELD_PX = 2.0  # of tip inside, when the shaft is seen to enter the wall
LEAST_FREE_MM = 0.8  # when it is not
MOUTH_MM = 0.55  # of the hole, inside the wall, may look like a needle where it was never seen without one
LEAST_OUTSIDE_MM = 1.0
AT_WALL_MM = 0.22


class Reach(Struct, frozen=True):
    """How far a needle was seen to reach."""

    where: Literal["outside", "hidden", "inside"]
    """Where its tip is: before the wall, in it, or in the globe."""
    tip_px: float
    """Along the strip; of a hidden tip, where the shaft vanishes."""
    evidence_px: float
    """Length that shows a needle less length that shows none."""
    deviation_px: float = 5.0
    contrast_grey: float = 0.0
    """Of the needle behind its tip; 0 where it was not measured."""


def find_reach(
    strip: Strip, px_per_mm: float, usual_grey: float | None, followed_px: float = -math.inf
) -> Reach | None:
    """Find how far the needle reaches, roughly.

    Args:
        strip: The straightened surroundings; the shaft lies near the middle.
        px_per_mm: Scale.
        usual_grey: Contrast that this needle had inside before, where known.
        followed_px: How far it reached just before: up to there less shows that it still does.

    Returns:
        The reach, or None if there is no needle.
    """
    contrast, noise = core_contrast(strip)
    is_sure = strip.is_known | (strip.u_px <= followed_px)
    outer, inner = strip.before, strip.inside
    outer_end, outer_sum = _farthest(_evidence(contrast[outer], is_sure[outer], noise, 0.0))
    inner_end, inner_sum = _farthest(_evidence(contrast[inner], is_sure[inner], noise, usual_grey or 0.0))
    is_outside = outer_sum >= LEAST_OUTSIDE_MM * px_per_mm
    gap = strip.is_known[outer_end : strip.before.stop]
    is_held = is_outside and len(gap) <= AT_WALL_MM * px_per_mm / STATION_PX and np.count_nonzero(gap) < 2
    is_mouth_known = bool(strip.is_known[strip.inside][: math.ceil(MOUTH_MM * px_per_mm / STATION_PX)].all())
    held_px = LEAST_HELD_PX + (0 if is_mouth_known else MOUTH_MM * px_per_mm)
    if inner_sum >= (held_px if is_held else LEAST_FREE_MM * px_per_mm):
        tip_px = float(strip.u_px[strip.inside.start + inner_end - 1])
        return Reach("inside", tip_px, inner_sum + outer_sum)
    if is_outside:
        return Reach("hidden" if is_held else "outside", float(strip.u_px[outer_end - 1]), outer_sum)
    return None


def is_led_to(strip: Strip, end_px: float, gap_px: float) -> bool:
    """Tell whether a shaft that ends somewhere may reach the wall all the same.

    Where the empty eye is not known, the wall itself and the hole's mouth look like a needle.

    Args:
        strip: The straightened surroundings.
        end_px: Where along the strip the shaft seems to end.
        gap_px: How far from the wall it may be there.
    """
    gap = slice(int(strip.u_px.searchsorted(end_px)), strip.before.stop)
    return (gap.stop - gap.start) * STATION_PX <= gap_px or bool(strip.is_known[gap].all())


def core_contrast(strip: Strip, part: slice = slice(None)) -> tuple[FloatImage, float]:
    """Return the contrast of the middle lanes at some stations, (n,), and more than noise makes of it."""
    core = slice(strip.half_px - 2, strip.half_px + 3)
    contrast = _contrast(strip.excess[core, part], strip.beside[core, part], CORE)
    return contrast, LEAST_SNR * strip.noise_grey / math.sqrt(len(CORE))


def closeup_px(about_px: float, spare_px: int = 0) -> FloatImage:
    """Return the places along a line at which a tip is looked at closely, (n,)."""
    about = round(about_px)
    return np.arange(about - BEHIND_PX - spare_px, about + AHEAD_PX + spare_px + 1, dtype=np.float32)


def refine_tip(
    strip: Strip,
    reach: Reach,
    about_px: float,
    aside_px: float = 0.0,
    behinds_px: tuple[int, ...] = (BEHIND_PX, NEAR_PX),
) -> Reach | None:
    """Find the tip sub-pixel: where the contrast falls off from what it was just behind.

    Args:
        strip: A close-up of the tip.
        reach: Roughly.
        about_px: Where along the strip the tip is, to some pixels.
        aside_px: How far from the strip's middle the shaft lies there.
        behinds_px: How much of the needle tells what its contrast is, from one look to the next.

    Returns:
        The reach, or None if the contrast does not fall there.
    """
    part = strip.inside if reach.where == "inside" else strip.before
    middle = round(about_px) - round(float(strip.u_px[0]))
    last = min(middle + AHEAD_PX + 1, len(strip.u_px))
    seen = slice(max(middle - BEHIND_PX, part.start), min(last, part.stop))
    if seen.stop - seen.start < 2:
        return None
    lane, rest = divmod(strip.half_px + aside_px, 1)
    core = slice(int(lane) - 1, int(lane) + 3)
    weights = np.array(((1 - rest) / 3, 1 / 3, 1 / 3, rest / 3), np.float32)
    along = _contrast(strip.excess[core, seen], strip.beside[core, seen], weights).tolist()
    tones = (weights @ strip.excess[core, seen]).tolist()
    is_sure = strip.is_known[seen].tolist() if reach.where == "outside" else [True] * len(along)
    noise = strip.noise_grey / math.sqrt(3)
    first_px = float(strip.u_px[seen.start])
    end, place, steepness, high = math.ceil(about_px - first_px), 0.0, 1.0, 0.0
    for behind_px in behinds_px:
        behind = slice(max(end - behind_px, 0), max(end - BLUNT_PX, 1))
        shaft = sorted(along[behind])
        high, low = shaft[len(shaft) // 2], _beyond(along[end:], is_sure[end:])
        if low > (LEAST_FALL if all(is_sure[end:]) else UNKNOWN_FALL) * high:
            return None
        one_tone = _one_tone(tones[behind], shaft) if reach.where == "inside" else 1.0
        share = FADING_LEVEL + one_tone * (TIP_LEVEL - FADING_LEVEL)
        level = max(low + share * (high - low), LEAST_SNR * noise)
        end = _last_above(along, is_sure, level)
        if end < 0 or (end == len(along) - 1 and seen.stop == last):
            return None
        place = float(end)
        if end < len(along) - 1:
            steepness = max(along[end] - along[end + 1], 1.0)
            fall_px = min(max((high - low) / steepness, SHARP_FALL_PX), LONGEST_FALL_PX)
            place += (along[end] - level) / steepness - BLUR_SHARE * one_tone * (fall_px - SHARP_FALL_PX)
    return replace(
        reach,
        tip_px=first_px + place,
        deviation_px=math.hypot(FLOOR_PX, noise / steepness),
        contrast_grey=high,
    )


def _one_tone(tones: list[float], contrasts: list[float]) -> float:
    """Return whether a shaft is darker or brighter throughout, 1, or its rims and its middle differ, 0."""
    share = abs(sum(tones)) / max(sum(contrasts), FLOOR_GREY)
    return min(max((share - ONE_TONE) / (1 - ONE_TONE), 0.0), 1.0)


def _beyond(along: list[float], is_sure: list[bool]) -> float:
    """Return the contrast beyond a tip: a quartile, for a longer tip may reach in.

    On unknown ground it is the least, for the wall has some, but not that at its blurred edge.

    Args:
        along: Contrast from the tip on.
        is_sure: Where it means something.
    """
    sure = sorted(grey for grey, one in zip(along[BEYOND_PX:], is_sure[BEYOND_PX:], strict=True) if one)
    if sure:
        return sure[len(sure) // 4]
    return 0.0 if all(is_sure) else min(along[:-WALL_PX], default=0.0)


def _last_above(along: list[float], is_sure: list[bool], level: float) -> int:
    """Return the last station with so much contrast, -1 if there is none.

    After a gap, only sure ones count: the wall looks like a needle where it is not known.
    """
    above = [station for station, grey in enumerate(along) if grey >= level]
    joined = next((n for n in range(1, len(above)) if above[n] > above[n - 1] + 1), len(above))
    return max([*above[:joined], *(station for station in above[joined:] if is_sure[station])], default=-1)


def _contrast(excess: FloatImage, beside: FloatImage, weights: FloatImage) -> FloatImage:
    """Return how much the shaft's middle differs from what is beside and was behind it [grey levels].

    It must differ from both: a stain that was always there is no needle, nor is a place that a needle has
    left. The root mean square counts, for a needle may be darker on one side and brighter on the other, and
    only its rims may show.
    """
    differs, stands_out = weights @ np.square(excess), weights @ np.square(beside)
    return np.asarray(np.sqrt(np.minimum(differs, 4 * stands_out)), np.float32)


def _evidence(contrast: FloatImage, is_sure: Mask, noise_grey: float, usual_grey: float) -> FloatImage:
    """Return how much every station looks like a needle, -1 to 1."""
    sure = max(LEAST_GREY, noise_grey, KNOWN_SHARE * usual_grey)
    unsure = max(UNKNOWN_GREY, noise_grey, UNKNOWN_SHARE * usual_grey)
    share = contrast * np.where(is_sure, np.float32(1 / sure), np.float32(1 / unsure))
    return np.asarray(np.minimum(share, 2) - 1, np.float32)


def _farthest(evidence: FloatImage) -> tuple[int, float]:
    """Return where the summed evidence is greatest (stations from the start) and how great it is."""
    if not len(evidence):
        return 0, 0.0
    total = np.cumsum(evidence)
    end = int(total.argmax())
    return (end + 1, STATION_PX * float(total[end])) if total[end] > 0 else (0, 0.0)
