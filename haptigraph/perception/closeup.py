"""Where a tip is, sub-pixel: the step from needle to no needle along the shaft.

Turns a strip that shows the tip closely, and where it is roughly, into its place along the strip. Blur takes
the step beyond the tip, a point that gets thin or dim takes it before. Knows no line but the strip's own.
"""

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.perception.pixels import FloatImage
from haptigraph.perception.sharpness import AROUND_PX, is_sharp
from haptigraph.perception.strip import Strip
from haptigraph.perception.tip import LEAST_SNR, Reach, contrast_along

__all__ = ["FADING_LEVEL", "closeup_px", "refine_tip"]

BEHIND_PX, AHEAD_PX = 12, 10  # how much of the needle, and of what follows, tells where it ends
NEAR_PX, BLUNT_PX = 7, 2
TIP_LEVEL = 0.36  # between beyond and behind: the point is thin and rounded, half is seen too early
FADING_LEVEL = 0.3  # of dark rims about a bright middle: where they are thin, blur takes one from the other
ONE_TONE = 0.8  # share of the contrast that is of one sign, below which a point fades like that
FOCUSED_PX, BLURRED_PX = 0.8, 1.0  # blur across the edges of a shaft in focus, and out of it
BLUR_SHARE = 0.4  # of more blur than in focus: it takes the level beyond the point
POINT_PX, POINT_ROUNDS = 4, 4  # how much of a point tells its contrast, and how often it is followed further
FOLLOWED_PX = 4.0  # from where the contrast first fell
LEAST_ONE_TONE = 0.2  # of a point that is followed: where rims and middle differ they end in different places
FAINT_LEVEL = 0.12  # the same as TIP_LEVEL for the last, faint part of a point
LONGEST_FAINT_PX = 6
FAINT_SHARP = 0.65  # of its contrast: so much a narrow part differs from what is beside it, no wide one
FAINT_BLUR_PX, FAINT_BLUR_RATE = 0.65, 2.5  # how far blur takes it beyond the point; more per px of blur
LEAST_FALL = 0.6  # what is beyond has less than this share of the contrast behind
UNKNOWN_FALL = 0.4  # the same before a wall that was never seen without a needle
BEYOND_PX = 4  # the blurred end of the tip
WALL_PX = 2  # of the wall's edge
FLOOR_PX, FLOOR_GREY = 0.1, 1e-3


class _Profile(Struct, frozen=True, eq=False):
    """A close-up's contrast along the shaft, one value per station [grey levels]."""

    along: list[float]
    tones: list[float] | None
    """Mean difference from the empty eye, with its sign; None where it does not matter."""
    is_sure: list[bool]
    """Where a contrast means something."""
    noise_grey: float
    """Standard deviation of a pixel."""
    goes_on: bool
    """Whether there is more to see beyond its last station."""
    around: FloatImage
    """Difference from the empty eye in the lanes around the shaft's middle, (lanes, n)."""

    @property
    def contrast_noise_grey(self) -> float:
        """Standard deviation of the contrast."""
        return self.noise_grey / math.sqrt(3)


class _Fall(Struct, frozen=True):
    """Where the contrast falls off."""

    end: int
    """The last station before."""
    place_px: float
    """From the first station on."""
    slope: float
    """Grey levels per px."""
    high_grey: float
    """Contrast behind it."""
    one_tone: float
    """Whether what is behind it is darker or brighter throughout, 1, or its rims and its middle differ, 0."""


def closeup_px(about_px: float, spare_px: int = 0) -> FloatImage:
    """Return the places along a line at which a tip is looked at closely, (n,)."""
    about = round(about_px)
    return np.arange(about - BEHIND_PX - spare_px, about + AHEAD_PX + spare_px + 1, dtype=np.float32)


def refine_tip(
    strip: Strip,
    reach: Reach,
    about_px: float,
    aside_px: float = 0.0,
    blur_px: float = FOCUSED_PX,
    behinds_px: tuple[int, ...] = (BEHIND_PX, NEAR_PX),
) -> Reach | None:
    """Find the tip sub-pixel: where the contrast falls off from what it was just behind.

    A point in focus that gets thin or dim towards its end is followed: what is just behind is looked at anew
    from where the contrast fell, as long as that leads on, and what is left beyond, if it is sharp.

    Args:
        strip: A close-up of the tip.
        reach: Roughly.
        about_px: Where along the strip the tip is, to some pixels.
        aside_px: How far from the strip's middle the shaft lies there.
        blur_px: Deviation of the blur across the shaft's edges.
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
    profile = _profile(strip, reach, seen, aside_px, seen.stop == last)
    first_px = float(strip.u_px[seen.start])
    fall = _fall(profile, math.ceil(about_px - first_px), behinds_px[0])
    for behind_px in behinds_px[1:]:
        fall = fall and _fall(profile, fall.end, behind_px)
    if fall is None:
        return None
    point = fall
    if blur_px < BLURRED_PX:
        point = _followed(profile, fall)
        if reach.where == "inside":  # outside there is more to see on the ground
            point = _faint_end(profile, point, blur_px)
    return replace(
        reach,
        tip_px=first_px + point.place_px - BLUR_SHARE * point.one_tone * max(blur_px - FOCUSED_PX, 0.0),
        deviation_px=math.hypot(FLOOR_PX, profile.contrast_noise_grey / point.slope),
        contrast_grey=fall.high_grey,
    )


def _followed(profile: _Profile, fall: _Fall) -> _Fall:
    """Return where a point ends that gets thin or dim beyond where its contrast first falls."""
    point = fall
    for _ in range(POINT_ROUNDS):
        further = _fall(profile, point.end, POINT_PX, 0)
        if further is None or further.one_tone < LEAST_ONE_TONE:
            break
        if not point.place_px < further.place_px <= fall.place_px + FOLLOWED_PX:
            break
        point = further
    return point


def _faint_end(profile: _Profile, point: _Fall, blur_px: float) -> _Fall:
    """Return where a point ends of which a faint part is left beyond where its contrast falls.

    That part must be narrow: a blurred end, a shadow and a bubble are not.
    """
    along, start = profile.along, point.end + 1
    high, low = _levels(profile, _behind(point.end, POINT_PX, 0), point.end)
    level = max(low + FAINT_LEVEL * (high - low), LEAST_SNR * profile.contrast_noise_grey)
    stop = next((station for station in range(start, len(along)) if along[station] < level), len(along))
    if not 0 < stop - start <= LONGEST_FAINT_PX or point.one_tone < LEAST_ONE_TONE:
        return point
    if stop == len(along) and profile.goes_on:
        return point
    end_px, _ = _crossing(along, stop - 1, level)
    end_px -= FAINT_BLUR_PX + FAINT_BLUR_RATE * max(blur_px - FOCUSED_PX, 0.0)
    is_narrow = is_sharp(profile.around[:, start:stop], FAINT_SHARP, profile.noise_grey)
    return replace(point, place_px=end_px) if is_narrow and end_px > point.place_px else point


def _profile(strip: Strip, reach: Reach, seen: slice, aside_px: float, goes_on: bool) -> _Profile:
    lane, rest = divmod(strip.half_px + aside_px, 1)
    core = slice(int(lane) - 1, int(lane) + 3)
    weights = np.array(((1 - rest) / 3, 1 / 3, 1 / 3, rest / 3), np.float32)
    along = contrast_along(strip.excess[core, seen], strip.beside[core, seen], weights).tolist()
    is_outside = reach.where == "outside"
    around = slice(max(int(lane) - AROUND_PX, 0), int(lane) + 1 + AROUND_PX)
    return _Profile(
        along,
        None if is_outside else (weights @ strip.excess[core, seen]).tolist(),
        strip.is_known[seen].tolist() if is_outside else [True] * len(along),
        strip.noise_grey,
        goes_on,
        strip.excess[around, seen],
    )


def _fall(profile: _Profile, end: int, behind_px: int, blunt_px: int = BLUNT_PX) -> _Fall | None:
    """Return where, about a station, the contrast falls off from what it is behind; None if it does not."""
    along, is_sure = profile.along, profile.is_sure
    behind = _behind(end, behind_px, blunt_px)
    high, low = _levels(profile, behind, end)
    if low > (LEAST_FALL if all(is_sure[end:]) else UNKNOWN_FALL) * high:
        return None
    one_tone = _one_tone(profile.tones[behind], along[behind]) if profile.tones else 1.0
    share = FADING_LEVEL + one_tone * (TIP_LEVEL - FADING_LEVEL)
    level = max(low + share * (high - low), LEAST_SNR * profile.contrast_noise_grey)
    end = _last_above(along, is_sure, level)
    if end < 0 or (end == len(along) - 1 and profile.goes_on):
        return None
    return _Fall(end, *_crossing(along, end, level), high, one_tone)


def _behind(end: int, behind_px: int, blunt_px: int) -> slice:
    """Return the stations that tell the contrast of what is behind one, but for a blunt end."""
    return slice(max(end - behind_px, 0), max(end - blunt_px, 1))


def _levels(profile: _Profile, behind: slice, end: int) -> tuple[float, float]:
    """Return the contrast of what is behind a tip, a median, and beyond."""
    shaft = sorted(profile.along[behind])
    return shaft[len(shaft) // 2], _beyond(profile.along[end:], profile.is_sure[end:])


def _crossing(along: list[float], end: int, level: float) -> tuple[float, float]:
    """Return where, after a station, a contrast crosses a level, and its slope there [grey levels per px]."""
    if end == len(along) - 1:
        return float(end), 1.0
    slope = max(along[end] - along[end + 1], 1.0)
    return end + (along[end] - level) / slope, slope


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
