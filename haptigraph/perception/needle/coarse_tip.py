"""The coarse tip: how far there is contrast along the shaft.

Turns a rectified strip into the tip's approximate position along it, by the contrast of its middle lanes
(`native/coarse_tip.c`), and on, where that is lost, by the shaft's own colour. The wall occludes a tip that
is in it, and so does a cannula.
"""

import math
from collections.abc import Iterable
from typing import Literal, TypeAlias

from msgspec import Struct

from haptigraph.perception.native import strip as native
from haptigraph.perception.needle.rectify import RectifiedStrip

__all__ = ["EXPOSED_MM", "Cannulas", "TipEstimate", "estimate_coarse_tip", "may_reach_wall"]

Where: TypeAlias = Literal["outside", "occluded", "inside"]

WHERE: tuple[Where, ...] = ("outside", "occluded", "inside")  # as C numbers them, from 1 on

EXPOSED_MM = 2.0
"""Outside the trocar: a tip this far out is the end, also before a cannula's hub."""

CANNULA_MM = 2.5  # inside the globe, at most
CANNULA_END_PX = 3.0  # between a tip and the end of a cannula that may hide it
LEADING_MM = 1.0  # of a needle outside that leads to what is inside


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
    """The same with what shifts it in many images alike: blur, or a point that fades; 0 if unknown."""
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


class Cannulas:
    """Where cannulas end that stood in the globe before a needle came: a tip that is there may be in one.

    A cannula turns with its needle, so the background does not show it where it is now.

    Args:
        px_per_mm: Scale.
    """

    def __init__(self, px_per_mm: float) -> None:
        self._px_per_mm = px_per_mm
        self.reset()

    def reset(self) -> None:
        """Forget them."""
        self._ends_px: list[float] = []

    def learn(self, seen: Iterable[tuple[RectifiedStrip, TipEstimate]]) -> None:
        """Remember the cannulas among what is seen without a needle, if there are some."""
        ends_px = [tip.u_px for strip, tip in seen if self._is_short_and_free(strip, tip)]
        self._ends_px = ends_px or self._ends_px

    def may_hide(self, tip: TipEstimate) -> bool:
        """Return whether a tip is where a needle that enters or leaves one of them seems to end."""
        if tip.where == "outside":
            return bool(self._ends_px) and tip.u_px > -EXPOSED_MM * self._px_per_mm
        off_px = (abs(tip.u_px - end_px) for end_px in self._ends_px)
        return tip.where == "inside" and min(off_px, default=math.inf) < CANNULA_END_PX

    def include(self, strip: RectifiedStrip, tip: TipEstimate) -> bool:
        """Return whether what ends at a tip is one of them, without a needle."""
        return self.may_hide(tip) and self._is_short_and_free(strip, tip)

    def _is_short_and_free(self, strip: RectifiedStrip, tip: TipEstimate) -> bool:
        """Return whether something short is in the globe, and no needle outside leads to it."""
        if tip.where != "inside":
            return False
        inside_px = tip.u_px - strip.inner_px
        outside_px = tip.evidence_px - inside_px
        return inside_px <= CANNULA_MM * self._px_per_mm and outside_px < LEADING_MM * self._px_per_mm
