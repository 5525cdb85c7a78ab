"""The sub-pixel tip: the contrast step from needle to no needle along the shaft.

Turns a tip patch, a rectified strip with a station per pixel, and an approximate tip into the tip's position
along it (`native/subpixel_tip.c`). Blur takes the step beyond the tip; a point that gets thin or dim takes it
before.
"""

import math

import numpy as np
from msgspec.structs import replace

from haptigraph.imaging import FloatImage
from haptigraph.perception.native import strip as native
from haptigraph.perception.needle.coarse_tip import TipEstimate
from haptigraph.perception.needle.rectify import RectifiedStrip

__all__ = ["FADING_LEVEL", "covers_tip", "refine_tip", "tip_patch_px"]

AHEAD_PX = 10  # of what follows the needle in a tip patch
FADING_LEVEL = 0.3  # of dark rims about a bright middle: where they are thin, blur takes one from the other


def tip_patch_px(about_px: float, margin_px: int = 0) -> FloatImage:
    """Return the positions along a line of a tip patch, (n,)."""
    about = round(about_px)
    return np.arange(about - native.BEHIND_PX - margin_px, about + AHEAD_PX + margin_px + 1, dtype=np.float32)


def covers_tip(patch: RectifiedStrip, about_px: float) -> bool:
    """Return whether a tip patch is large enough for a tip about a position."""
    about, u_px = round(about_px), patch.u_px
    return bool(u_px[0] <= about - native.BEHIND_PX and about + AHEAD_PX <= u_px[-1])


def refine_tip(
    patch: RectifiedStrip,
    tip: TipEstimate,
    about_px: float,
    off_axis_px: float = 0.0,
    blur_px: float = 0.0,
    *,
    uses_chroma: bool = False,
) -> TipEstimate | None:
    """Locate the tip sub-pixel: where the contrast falls from that just behind it.

    Blur counts as far as the step is blurred, too: motion may blur the edges alone. A point in focus that
    gets thin or dim towards its end is followed: the contrast just behind is measured again from each step,
    as long as that leads on, and then a faint rest beyond it, if it is sharp.

    Args:
        patch: A tip patch.
        tip: The approximate tip.
        about_px: Where along the patch the tip is, to some pixels.
        off_axis_px: How far from the patch's middle the shaft is there.
        blur_px: Standard deviation of the blur, of the shaft's edges or of the picture.
        uses_chroma: Whether the contrast is that of its colour, too.

    Returns:
        The tip, or None if the contrast does not fall there.
    """
    is_inside = tip.where == "inside"
    part = patch.inside if is_inside else patch.outside
    middle = round(about_px) - round(float(patch.u_px[0]))
    last = min(middle + AHEAD_PX + 1, len(patch.u_px))
    start, stop = max(middle - native.BEHIND_PX, part.start), min(last, part.stop)
    if stop - start < 2:
        return None
    first_px = float(patch.u_px[start])
    found = native.refine_tip(
        *(patch, start, stop, math.ceil(about_px - first_px)),
        *(patch.half_px + off_axis_px, blur_px, FADING_LEVEL),
        continues=stop == last,
        is_outside=tip.where == "outside",
        uses_chroma=uses_chroma,
    )
    if found is None:
        return None
    at_px, sd_px, contrast_grey = found
    return replace(tip, u_px=first_px + at_px, sd_px=sd_px, contrast_grey=contrast_grey)
