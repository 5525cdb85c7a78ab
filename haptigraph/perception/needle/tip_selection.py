"""Where a shaft ends whose line is known: which of several falls of contrast is its tip.

Turns one sight of a needle into how far it reaches, sub-pixel: to where its edges end, to where its tip was
expected, or as far as there is contrast. Knows no image before.
"""

import math

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.messages import Image
from haptigraph.perception.needle.background import Background
from haptigraph.perception.needle.bevel import Bevel
from haptigraph.perception.needle.coarse_tip import TipEstimate, is_led_to
from haptigraph.perception.needle.rectify import Line, RectifiedStrip, Site
from haptigraph.perception.needle.shaft_line import LineFit
from haptigraph.perception.needle.sharp_tip import (
    LONGEST_DIM_PX,
    SHORTEST_DIM_PX,
    dim_end_px,
    goes_on,
    is_plain_end,
    sharp_end,
)
from haptigraph.perception.needle.subpixel_tip import refine_tip, shows, tip_patch_px

__all__ = ["OFF_PX", "Candidate", "Detection", "TipSelector"]

GAP_MM = 0.65  # of unknown ground before the wall that is taken for the shaft
AT_WALL_PX = 3.8  # blurred edge of the wall
ENDS_PX, EDGES_END_PX = 4.0, 9.0  # beyond a tip, until where a shaft and its edges may seem to go on
NEAR_PX = 3.0  # between where the tip is expected and where it is, mostly
PLAIN_PX = 8.0  # the same where it is plain to see
SHARP_END_PX = 2.5  # between the end of what is sharp and the fall of contrast there, if it has one
CENTRED_PX = 2.0  # a tip further beyond the middle of its close-up is looked at anew
OFF_PX = 3.0
"""If a tip is further off the strip's middle, it has to be looked at in a strip of its own."""

DIM_BEHIND_PX = 6  # of a dim point, tells its contrast


class Candidate(Struct, frozen=True, eq=False):
    """Something like a needle along an expected line."""

    expected: Line
    strip: RectifiedStrip
    closeup: RectifiedStrip | None
    """About where the tip was expected."""
    reach: TipEstimate


class Detection(Struct, frozen=True, eq=False):
    """One needle as measured in one image."""

    glimpse: Candidate
    line: Line
    fit: LineFit
    reach: TipEstimate

    @property
    def off_px(self) -> float:
        """How far the tip was from where the strip expected it, across."""
        return abs(self.fit.offset_px + self.fit.slope * self.reach.tip_px)


class TipSelector:
    """Find where needles end.

    Args:
        site: Where things are.
        background: The empty eye, as far as it is known when a needle is looked at.
        bevel: How far beside the axis the tip lies, as far as that is known.
    """

    def __init__(self, site: Site, background: Background, bevel: Bevel) -> None:
        self._site, self._background, self._bevel = site, background, bevel

    def __call__(self, image: Image, sight: Detection, expected_px: float = math.inf) -> TipEstimate:
        """Appearance at a tip closely.

        Args:
            image: (h, w, 3) BGR or (h, w) grey.
            sight: The needle, and how far it reaches, roughly.
            expected_px: Where along the line the tip was expected.
        """
        strip, fit, reach = sight.glimpse.strip, sight.fit, sight.reach
        edges_end_px = fit.end_px(float(strip.u_px[0]))
        inner_px = float(strip.u_px[strip.inside.start]) if reach.where == "inside" else math.inf
        most_gap_px = GAP_MM * self._site.px_per_mm
        is_led = is_led_to(strip, edges_end_px, most_gap_px) or fit.leads_through(inner_px)
        if reach.where == "inside" and not is_led:
            reach = replace(reach, where="outside", tip_px=edges_end_px)
        if reach.where == "hidden":
            return self._before_wall(image, sight, reach, edges_end_px) or reach
        rim_px = -math.inf
        if reach.where == "inside":
            edges_end_px = fit.end_px(inner_px)
            rim_px = min(inner_px + AT_WALL_PX, reach.tip_px - EDGES_END_PX)  # before it is the mouth
        fall = self._expected_fall(image, sight, reach, expected_px, edges_end_px)
        if fall and fall.tip_px > rim_px:
            return fall
        places_px = dict.fromkeys((min(reach.tip_px, edges_end_px), reach.tip_px))
        falls = (self._fall(image, sight, reach, about_px) for about_px in places_px)
        return next((fall for fall in falls if fall and fall.tip_px > rim_px), reach)

    def _before_wall(
        self, image: Image, sight: Detection, reach: TipEstimate, edges_end_px: float
    ) -> TipEstimate | None:
        """Return the tip that is seen before the wall though something like a shaft reaches it."""
        strip, before = sight.glimpse.strip, replace(reach, where="outside")
        seen = self._fall(image, sight, before, min(edges_end_px, reach.tip_px))
        return seen if seen and self._is_free(strip, seen.tip_px, reach.tip_px, edges_end_px) else None

    def _expected_fall(
        self, image: Image, sight: Detection, reach: TipEstimate, expected_px: float, edges_end_px: float
    ) -> TipEstimate | None:
        """Return, of several falls, the one that was the tip before."""
        if expected_px >= reach.tip_px + NEAR_PX:
            return None
        fall = self._fall(image, sight, reach, expected_px)
        if fall is None or abs(fall.tip_px - edges_end_px) < EDGES_END_PX:
            return fall  # what is beyond, a bead or a bubble, has edges that are not in line with the shaft's
        strip, off_px = sight.glimpse.strip, abs(fall.tip_px - expected_px)
        is_free = off_px < NEAR_PX and not goes_on(strip, fall.tip_px, reach.tip_px)
        return fall if is_free or (off_px < PLAIN_PX and is_plain_end(strip, fall, reach.tip_px)) else None

    def _is_free(self, strip: RectifiedStrip, tip_px: float, reach_px: float, edges_end_px: float) -> bool:
        """Tell whether a tip right before the wall is one, and not a faint place of a shaft that goes on.

        On known ground the shaft must end there; on unknown ground, where the wall may look like a shaft, its
        edges must if the wall is far.
        """
        gap_px = float(strip.u_px[strip.before.stop - 1]) - tip_px
        if gap_px <= AT_WALL_PX:
            return False
        if is_led_to(strip, tip_px, 0.0):
            return reach_px <= tip_px + ENDS_PX
        return gap_px <= GAP_MM * self._site.px_per_mm or edges_end_px <= tip_px + EDGES_END_PX

    def _fall(
        self, image: Image, sight: Detection, reach: TipEstimate, about_px: float
    ) -> TipEstimate | None:
        """Appearance closely for the tip about a place, and about where it is if that is well beyond."""
        fall = self._fall_near(image, sight, reach, about_px)
        if fall and fall.tip_px > about_px + CENTRED_PX:
            return self._fall_near(image, sight, reach, fall.tip_px) or fall
        return fall

    def _fall_near(
        self, image: Image, sight: Detection, reach: TipEstimate, about_px: float
    ) -> TipEstimate | None:
        at_hand, bevel_px = sight.glimpse.closeup, self._bevel.aside_px if reach.where == "inside" else 0.0
        aside_px = sight.fit.offset_px + sight.fit.slope * about_px
        if at_hand and shows(at_hand, about_px) and abs(aside_px) <= OFF_PX:
            return refine_tip(at_hand, reach, about_px, aside_px + bevel_px, sight.fit.blur_px)
        near = self._background.strips(image, sight.line, tip_patch_px(about_px))
        return refine_tip(near[0], reach, about_px, bevel_px, sight.fit.blur_px) if near else None

    def before_shadow(self, image: Image, sight: Detection, reach: TipEstimate) -> TipEstimate | None:
        """Return where a shaft ends that goes on as its shadow, None if it does not."""
        sharp = sharp_end(sight.glimpse.strip, reach) if reach.where == "inside" else None
        if sharp is None:
            return None
        fall = self._fall(image, sight, sharp, sharp.tip_px)
        return fall if fall and abs(fall.tip_px - sharp.tip_px) < SHARP_END_PX else sharp

    def dim_point(self, image: Image, sight: Detection, reach: TipEstimate) -> TipEstimate | None:
        """Return how far a point reaches that gets dim before its end, None if it does not."""
        dim_px = sight.glimpse.reach.tip_px - reach.tip_px
        if reach.where != "inside" or not SHORTEST_DIM_PX <= dim_px <= LONGEST_DIM_PX:
            return None
        places_px = tip_patch_px(reach.tip_px, LONGEST_DIM_PX)
        strips = self._background.strips(image, sight.line, places_px)
        end_px = dim_end_px(strips[0], reach) if strips else None
        if strips is None or end_px is None:
            return None
        return refine_tip(strips[0], reach, end_px, blur_px=sight.fit.blur_px, behinds_px=(DIM_BEHIND_PX,))
