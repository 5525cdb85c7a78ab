"""The coarse tip: how far there is contrast along the shaft.

Turns a rectified strip into the tip's approximate position along it, by the contrast of its middle lanes
(`native/coarse_tip.c`). The wall occludes a tip that is in it.
"""

import math
from typing import Literal, TypeAlias

from msgspec import Struct

from haptigraph.perception.native import strip as native
from haptigraph.perception.needle.rectify import RectifiedStrip

__all__ = ["TipEstimate", "estimate_coarse_tip", "may_reach_wall"]

Where: TypeAlias = Literal["outside", "occluded", "inside"]

WHERE: tuple[Where, ...] = ("outside", "occluded", "inside")  # as C numbers them, from 1 on


class TipEstimate(Struct, frozen=True):
    """Where a tip is along its shaft."""

    where: Where
    """Outside the wall, occluded by it, or in the globe."""
    u_px: float
    """Along the strip; of an occluded tip, where the shaft vanishes."""
    evidence_px: float
    """Length that shows a needle less length that shows none."""
    sd_px: float = 5.0
    """What noise does to it."""
    shift_sd_px: float = 0.0
    """Standard deviation of what shifts it from the tip in many images alike: blur, or a point that fades."""
    contrast_grey: float = 0.0
    """Of the needle behind its tip; 0 if not measured."""
    is_known: bool = True
    """Whether the tip is there; else the shaft may be longer."""


def estimate_coarse_tip(
    strip: RectifiedStrip, px_per_mm: float, usual_grey: float | None, tracked_px: float = -math.inf
) -> TipEstimate | None:
    """Estimate how far the needle reaches.

    Args:
        strip: The strip; the shaft is near its middle.
        px_per_mm: Scale.
        usual_grey: Contrast that this needle had inside before, if known.
        tracked_px: Its expected tip: up to there, less contrast suffices.

    Returns:
        The tip, or None if there is no needle.
    """
    where, station, evidence_px = native.estimate_coarse_tip(strip, usual_grey or 0.0, tracked_px, px_per_mm)
    return TipEstimate(WHERE[where - 1], float(strip.u_px[station]), evidence_px) if where else None


def may_reach_wall(strip: RectifiedStrip, end_px: float) -> bool:
    """Return whether a shaft that seems to end outside the wall may still reach it.

    Where the background is unknown, the wall and the port opening look like a needle.

    Args:
        strip: The strip.
        end_px: Where along it the shaft seems to end.
    """
    gap = slice(int(strip.u_px.searchsorted(end_px)), strip.outside.stop)
    return bool(strip.is_known[gap].all())
