"""Where a tip is, sub-pixel: the step from needle to no needle along the shaft.

Turns a strip that shows the tip closely, and where it is roughly, into its place along the strip. Blur takes
the step beyond the tip, a point that gets thin or dim takes it before. Knows no line but the strip's own.
"""

import ctypes
import math
import struct
from functools import cache

import numpy as np
from msgspec.structs import replace

from haptigraph.imaging import FloatImage
from haptigraph.perception.native.library import function
from haptigraph.perception.needle.coarse_tip import TipEstimate
from haptigraph.perception.needle.rectify import RectifiedStrip
from haptigraph.perception.needle.sharpness import AROUND_PX

__all__ = ["FADING_LEVEL", "refine_tip", "shows", "tip_patch_px"]

BEHIND_PX, AHEAD_PX = 12, 10  # how much of the needle, and of what follows, tells where it ends
NEAR_PX = 7
FADING_LEVEL = 0.3  # of dark rims about a bright middle: where they are thin, blur takes one from the other
FOCUSED_PX, BLURRED_PX = 0.8, 1.0  # blur across the edges of a shaft in focus, and out of it

_Tip = ctypes.c_double * 3
_pack = struct.Struct("ddd8i").pack  # as C has it; four times as fast as so many arguments
_refine_tip = function("refine_tip", "pppip", ctypes.c_int)


def tip_patch_px(about_px: float, spare_px: int = 0) -> FloatImage:
    """Return the places along a line at which a tip is looked at closely, (n,)."""
    about = round(about_px)
    return np.arange(about - BEHIND_PX - spare_px, about + AHEAD_PX + spare_px + 1, dtype=np.float32)


def shows(closeup: RectifiedStrip, about_px: float) -> bool:
    """Tell whether a close-up shows a tip about a place closely."""
    about, u_px = round(about_px), closeup.u_px
    return bool(u_px[0] <= about - BEHIND_PX and about + AHEAD_PX <= u_px[-1])


def refine_tip(
    strip: RectifiedStrip,
    reach: TipEstimate,
    about_px: float,
    aside_px: float = 0.0,
    blur_px: float = FOCUSED_PX,
    behinds_px: tuple[int, ...] = (BEHIND_PX, NEAR_PX),
) -> TipEstimate | None:
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
    is_inside, is_focused = reach.where == "inside", blur_px < BLURRED_PX
    part = strip.inside if is_inside else strip.before
    middle = round(about_px) - round(float(strip.u_px[0]))
    last = min(middle + AHEAD_PX + 1, len(strip.u_px))
    start, stop = max(middle - BEHIND_PX, part.start), min(last, part.stop)
    if stop - start < 2:
        return None
    first_px, tip = float(strip.u_px[start]), _Tip()
    closeup = _pack(
        *(strip.half_px + aside_px, max(blur_px - FOCUSED_PX, 0.0), FADING_LEVEL),
        *(start, stop, stop == last, math.ceil(about_px - first_px), reach.where == "outside"),
        *(is_focused, is_focused and is_inside, AROUND_PX),  # outside there is more to see on the ground
    )
    if not _refine_tip(strip.native, closeup, _ints(behinds_px), len(behinds_px), tip):
        return None
    place_px, sd_px, contrast_grey = tip[:]
    return replace(reach, tip_px=first_px + place_px, sd_px=sd_px, contrast_grey=contrast_grey)


@cache
def _ints(values: tuple[int, ...]) -> ctypes.Array[ctypes.c_int]:
    return (ctypes.c_int * len(values))(*values)
