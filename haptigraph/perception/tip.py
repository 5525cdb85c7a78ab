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

from haptigraph.perception.pixels import FloatImage
from haptigraph.perception.strip import ROW_PX, Strip, median, row_sums

__all__ = ["AHEAD_PX", "BEHIND_PX", "Reach", "find_reach", "is_led_to", "refine_tip"]

LEAST_GREY = 5.0
UNKNOWN_GREY = 8.0
LEAST_SNR = 4.0
KNOWN_SHARE = 0.1  # of the contrast that the needle had before
UNKNOWN_SHARE = 0.35
BEHIND_PX, AHEAD_PX = 12, 10  # how much of the needle, and of what follows, tells where it ends
NEAR_PX, BLUNT_PX = 7, 2
TIP_LEVEL = 0.35  # of the contrast: the point is thin and rounded, half of it is seen too early
FLOOR_PX = 0.1
LEAST_HELD_PX = 2.0  # of tip inside, when the shaft is seen to enter the wall
MOUTH_MM = 0.4  # of the hole, inside the wall, may look like a needle where it was never seen without one
LEAST_FREE_MM = 0.8  # when it is not
LEAST_OUTSIDE_MM = 1.0
AT_WALL_MM = 0.22


class Reach(Struct, frozen=True):
    """How far a needle was seen to reach."""

    where: Literal["outside", "hidden", "inside"]
    """Where its tip is: before the wall, in it, or in the globe."""
    tip_px: float
    """Along the strip; of a hidden tip, where the shaft vanishes."""
    evidence_px: float
    """Rows that show a needle less rows that show none."""
    deviation_px: float = 5.0
    contrast_grey: float = 0.0
    """Of the needle behind its tip; 0 where it was not measured."""


def find_reach(strip: Strip, px_per_mm: float, usual_grey: float | None) -> Reach | None:
    """Find how far the needle reaches, roughly.

    Args:
        strip: The straightened surroundings; the shaft lies near the middle.
        px_per_mm: Scale.
        usual_grey: Contrast that this needle had inside before, where known.

    Returns:
        The reach, or None if there is no needle.
    """
    core = slice(strip.half_px - 2, strip.half_px + 3)
    contrast = _contrast(strip.excess[:, core], strip.beside[:, core])
    noise = LEAST_SNR * strip.noise_grey / math.sqrt(core.stop - core.start)
    known = max(LEAST_GREY, noise, KNOWN_SHARE * (usual_grey or 0))
    unknown = max(UNKNOWN_GREY, noise, UNKNOWN_SHARE * (usual_grey or 0))
    least = np.where(strip.is_known, known, unknown).astype(np.float32)
    evidence = np.clip(contrast / least - 1, -1, 1)
    outer_end, outer_sum = _farthest(evidence[strip.before])
    inner_end, inner_sum = _farthest(evidence[strip.inside])
    is_outside = outer_sum >= LEAST_OUTSIDE_MM * px_per_mm
    is_held = is_outside and outer_end >= strip.before.stop - AT_WALL_MM * px_per_mm / ROW_PX
    is_mouth_known = bool(strip.is_known[strip.inside][: math.ceil(MOUTH_MM * px_per_mm / ROW_PX)].all())
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
    return (gap.stop - gap.start) * ROW_PX <= gap_px or bool(strip.is_known[gap].all())


def refine_tip(strip: Strip, reach: Reach, about_px: float) -> Reach | None:
    """Find the tip sub-pixel: where the contrast falls off from what it was just behind.

    Args:
        strip: The straightened surroundings of the tip, the shaft along the middle.
        reach: Roughly.
        about_px: Where along the strip the tip is, to some pixels.

    Returns:
        The reach, or None if the contrast does not fall there.
    """
    rows = strip.inside if reach.where == "inside" else strip.before
    core = slice(strip.half_px - 1, strip.half_px + 2)
    u_px, along = strip.u_px[rows], _contrast(strip.excess[rows, core], strip.beside[rows, core])
    if len(u_px) < 2:
        return None
    noise = strip.noise_grey / math.sqrt(core.stop - core.start)
    end, place, steepness, high = int(u_px.searchsorted(about_px)), 0.0, 1.0, 0.0
    for behind_px in (BEHIND_PX, NEAR_PX):
        high = median(along[max(end - behind_px, 0) : max(end - BLUNT_PX, 1)])
        level = max(TIP_LEVEL * high, LEAST_SNR * noise)
        above = np.flatnonzero(along >= level)
        if reach.where == "outside":  # the wall follows, and looks like a needle where it is not known
            gap = int(np.append(np.diff(above) > 1, True).argmax())
            above = np.append(above[: gap + 1], above[gap + 1 :][strip.is_known[rows][above[gap + 1 :]]])
        if not len(above) or (above[-1] == len(along) - 1 and rows.stop == len(strip.u_px)):
            return None
        end = int(above[-1])
        place = float(end)
        if end < len(along) - 1:
            steepness = max(float(along[end] - along[end + 1]), 1.0)
            place += (float(along[end]) - level) / steepness
    return replace(
        reach,
        tip_px=float(u_px[0]) + place,
        deviation_px=math.hypot(FLOOR_PX, noise / steepness),
        contrast_grey=high,
    )


def _contrast(excess: FloatImage, beside: FloatImage) -> FloatImage:
    """Return how much the shaft's middle differs from what is beside and was behind it [grey levels].

    It must differ from both: a stain that was always there is no needle, nor is a place that a needle has
    left. The root mean square counts, for a needle may be darker on one side and brighter on the other, and
    only its rims may show.
    """
    weight = np.full(excess.shape[1], 1 / excess.shape[1], np.float32)
    differs, stands_out = (np.sqrt(row_sums(np.square(values), weight)) for values in (excess, beside))
    return np.asarray(np.minimum(differs, 2 * stands_out), np.float32)


def _farthest(evidence: FloatImage) -> tuple[int, float]:
    """Return where the summed evidence is greatest (rows from the start) and how great it is."""
    if not len(evidence):
        return 0, 0.0
    total = np.cumsum(evidence)
    end = int(total.argmax())
    return (end + 1, ROW_PX * float(total[end])) if total[end] > 0 else (0, 0.0)
