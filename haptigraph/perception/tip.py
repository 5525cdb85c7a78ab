"""How far the needle reaches, roughly: as far as there is contrast along the shaft.

Turns a strip into the tip's place along it. Evidence is summed from where the needle comes from, so that a
gap (glare, debris) is bridged and a thing beyond a long gap is not the needle. Nothing behind the wall can be
seen: a needle whose tip is in there has none.
"""

import math
from typing import Literal

import numpy as np
from msgspec import Struct

from haptigraph.perception.pixels import FloatImage, Mask
from haptigraph.perception.strip import STATION_PX, Strip

__all__ = [
    "LEAST_SNR",
    "Reach",
    "contrast_along",
    "core_contrast",
    "find_reach",
    "is_led_to",
]

CORE = np.full(5, 1 / 5, np.float32)  # lanes in the middle of a strip
LEAST_GREY = 5.0
UNKNOWN_GREY = 8.0
LEAST_SNR = 4.0
KNOWN_SHARE = 0.1  # of the contrast that the needle had before
UNKNOWN_SHARE = 0.35
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
    contrast = contrast_along(strip.excess[core, part], strip.beside[core, part], CORE)
    return contrast, LEAST_SNR * strip.noise_grey / math.sqrt(len(CORE))


def contrast_along(excess: FloatImage, beside: FloatImage, weights: FloatImage) -> FloatImage:
    """Return how much the shaft's middle differs from what is beside and was behind it [grey levels], (n,).

    It must differ from both: a stain that was always there is no needle, nor is a place that a needle has
    left. The root mean square counts, for a needle may be darker on one side and brighter on the other, and
    only its rims may show.

    Args:
        excess: Of the middle lanes of a strip, (lanes, n).
        beside: The same.
        weights: Of these lanes, (lanes,).
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
