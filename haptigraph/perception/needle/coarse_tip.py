"""How far the needle reaches, roughly: as far as there is contrast along the shaft.

Turns a strip into the tip's place along it, by the contrast of its middle (`native/coarse_tip.c`).
Nothing behind the wall can be seen: a needle whose tip is in there has none.
"""

import ctypes
import math
from typing import Literal, TypeAlias

import numpy as np
from msgspec import Struct

from haptigraph.imaging import FloatImage
from haptigraph.perception.native.library import address, function
from haptigraph.perception.needle.rectify import STATION_PX, RectifiedStrip

__all__ = ["TipEstimate", "core_contrast", "estimate_coarse_tip", "is_led_to"]

Where: TypeAlias = Literal["outside", "hidden", "inside"]

WHERE: tuple[Where, ...] = ("outside", "hidden", "inside")  # as C numbers them, from 1 on

_Told = ctypes.c_double * 2
_estimate_coarse_tip = function("estimate_coarse_tip", "pdddp", ctypes.c_int)
_core_contrast = function("core_contrast", "piip", ctypes.c_double)


class TipEstimate(Struct, frozen=True):
    """How far a needle was seen to reach."""

    where: Where
    """Where its tip is: before the wall, in it, or in the globe."""
    tip_px: float
    """Along the strip; of a hidden tip, where the shaft vanishes."""
    evidence_px: float
    """Length that shows a needle less length that shows none."""
    sd_px: float = 5.0
    contrast_grey: float = 0.0
    """Of the needle behind its tip; 0 where it was not measured."""


def estimate_coarse_tip(
    strip: RectifiedStrip, px_per_mm: float, usual_grey: float | None, followed_px: float = -math.inf
) -> TipEstimate | None:
    """Find how far the needle reaches, roughly.

    Args:
        strip: The straightened surroundings; the shaft lies near the middle.
        px_per_mm: Scale.
        usual_grey: Contrast that this needle had inside before, where known.
        followed_px: How far it reached just before: up to there less shows that it still does.

    Returns:
        The reach, or None if there is no needle.
    """
    told = _Told()
    where = _estimate_coarse_tip(strip.native, usual_grey or 0.0, followed_px, px_per_mm, told)
    if not where:
        return None
    last, evidence_px = told
    return TipEstimate(WHERE[where - 1], float(strip.u_px[int(last)]), evidence_px)


def is_led_to(strip: RectifiedStrip, end_px: float, gap_px: float) -> bool:
    """Tell whether a shaft that ends somewhere may reach the wall all the same.

    Where the empty eye is not known, the wall itself and the hole's mouth look like a needle.

    Args:
        strip: The straightened surroundings.
        end_px: Where along the strip the shaft seems to end.
        gap_px: How far from the wall it may be there.
    """
    gap = slice(int(strip.u_px.searchsorted(end_px)), strip.before.stop)
    return (gap.stop - gap.start) * STATION_PX <= gap_px or bool(strip.is_known[gap].all())


def core_contrast(strip: RectifiedStrip, part: slice) -> tuple[FloatImage, float]:
    """Return how much the middle lanes differ from what is beside and was behind them, and than noise makes.

    They must differ from both: a stain that was always there is no needle, nor is a place that a needle has
    left. The root mean square counts, for a needle may be darker on one side and brighter on the other, and
    only its rims may show.

    Args:
        strip: The straightened surroundings.
        part: Of its stations.

    Returns:
        The contrast of every one [grey levels], (n,), and more than noise makes of it.
    """
    start, stop, _ = part.indices(len(strip.u_px))
    contrast = np.empty(max(stop - start, 0), np.float32)
    return contrast, _core_contrast(strip.native, start, stop, address(contrast))
