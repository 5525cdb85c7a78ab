"""Tip selection: which of several contrast steps along a fitted shaft is its tip.

Turns a detection with an approximate tip into a sub-pixel tip: where the shaft's edges end, where the tip was
expected, or as far as there is contrast. `subpixel_tip.refine_tip` locates each of these steps.
"""

import math

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.messages import Image
from haptigraph.perception.native.strip import colored_share
from haptigraph.perception.needle.background import Background
from haptigraph.perception.needle.bevel import Bevel
from haptigraph.perception.needle.coarse_tip import TipEstimate, may_reach_wall
from haptigraph.perception.needle.focus import Focus
from haptigraph.perception.needle.rectify import EyeGeometry, Line, RectifiedStrip
from haptigraph.perception.needle.shaft_line import LineFit
from haptigraph.perception.needle.sharp_tip import continues, is_bright, is_clear_end, sharp_end
from haptigraph.perception.needle.subpixel_tip import covers_tip, refine_tip, tip_patch_px
from haptigraph.perception.needle.tip_network import FAR_SD_MM, TipJudge

__all__ = ["MAX_OFF_AXIS_PX", "Candidate", "Detection", "TipSelector"]

AT_WALL_PX = 3.8  # blurred edge of the wall
WALL_SD = 2.0  # standard deviations from the wall within which a tip outside may be in it
ENDS_PX, EDGES_END_PX = 4.0, 9.0  # beyond a tip, to which a shaft and its edges may seem to continue
NEAR_PX = 3.0  # between the expected and the actual tip, usually
CLEAR_PX = 8.0  # the same at a clear end
SHARP_END_PX = 2.5  # between the end of what is sharp and the contrast step there, if there is one
CENTERED_PX = 2.0  # a tip further beyond the middle of its patch is refined again
COLORED_PX, COLORED_SHARE = 1.0, 0.5  # of a shaft that continues beyond a contrast step, in colour
FAINT = 0.3  # of a step's contrast: least colour of its shaft that is followed
COLORED_SD_PX = 3.0

BESIDE_MM = 4.0  # of the trocar
UNJUDGED_MM = 0.03  # sd of a tip that the network has not judged: that of closed jaws
MAX_OFF_AXIS_PX = 3.0
"""A tip further off the strip's middle needs a strip of its own."""


class Candidate(Struct, frozen=True, eq=False):
    """Something like a needle along an expected line."""

    expected: Line
    strip: RectifiedStrip
    patch: RectifiedStrip | None
    """About the expected tip."""
    tip: TipEstimate


class Detection(Struct, frozen=True, eq=False):
    """One needle as measured in one image."""

    candidate: Candidate
    line: Line
    fit: LineFit
    tip: TipEstimate
    """Its tip."""

    @property
    def off_axis_px(self) -> float:
        """How far the tip is off the strip's middle."""
        return abs(self.fit.offset_px + self.fit.slope * self.tip.u_px)

    @property
    def edges_end_px(self) -> float:
        """How far along the strip both edges of the shaft are visible inside the globe."""
        return self.fit.end_px(self.candidate.strip.inner_px)

    def is_adrift(self, px_per_mm: float) -> bool:
        """Return whether what is in the globe does not show beside the wall: it is debris."""
        return self.tip.where == "inside" and not self.fit.is_beside(0.0, BESIDE_MM * px_per_mm)


class TipSelector:
    """Find where needles end.

    Args:
        eye: The eye's geometry.
        background: The background model.
        bevel: How far off the axis the tip is.
        focus: How blurred the picture is.
        uses_network: Whether the tip network judges a tip; else it is where it was selected.
    """

    def __init__(
        self,
        eye: EyeGeometry,
        background: Background,
        bevel: Bevel,
        focus: Focus,
        *,
        uses_network: bool = True,
    ) -> None:
        self._eye, self._background, self._bevel, self._focus = eye, background, bevel, focus
        self._judge = TipJudge() if uses_network else None
        self._was_inside = False

    def select(self, image: Image, detection: Detection, expected_px: float = math.inf) -> TipEstimate:
        """Select the contrast step that is the tip, and locate it sub-pixel.

        Args:
            image: (h, w, 3) BGR or (h, w) grey.
            detection: The needle, with an approximate tip.
            expected_px: Where along the line the tip was expected.
        """
        strip, fit, tip = detection.candidate.strip, detection.fit, detection.tip
        edges_end_px = fit.end_px(float(strip.u_px[0]))
        inner_px = strip.inner_px if tip.where == "inside" else math.inf
        enters = fit.leads_through(inner_px) or _shows_to_wall(strip, edges_end_px)
        if tip.where == "inside" and not enters:
            outside = replace(tip, where="outside", u_px=edges_end_px)
            step = self._end_of_shaft(image, detection, outside, expected_px, edges_end_px)
            return _doubted(step, tip.u_px, expected_px)
        if tip.where == "occluded":
            return self._before_wall(image, detection, tip, edges_end_px) or tip
        return self._end_of_shaft(image, detection, tip, expected_px, edges_end_px, inner_px)

    def _end_of_shaft(
        self,
        image: Image,
        detection: Detection,
        tip: TipEstimate,
        expected_px: float,
        edges_end_px: float,
        inner_px: float = math.inf,
    ) -> TipEstimate:
        """Return the contrast step at the end of the edges, where the tip was, or of the contrast."""
        rim_px = -math.inf
        if tip.where == "inside":
            edges_end_px = detection.fit.end_px(inner_px)
            rim_px = min(inner_px + AT_WALL_PX, tip.u_px - EDGES_END_PX)  # before it is the port opening
        step = self._expected_step(image, detection, tip, expected_px, edges_end_px)
        if step is None or step.u_px <= rim_px:
            step = self._contrast_step(image, detection, tip, edges_end_px, rim_px)
        return self._colored_end(image, detection, tip, step) or step

    def _colored_end(
        self, image: Image, detection: Detection, tip: TipEstimate, step: TipEstimate
    ) -> TipEstimate | None:
        """Return the end of a shaft that continues in a colour that no shadow explains; None if none does."""
        if tip.where != "inside" or not _continues_colored(detection.candidate.strip, step, tip.u_px):
            return None
        end = self._refine(image, detection, tip, tip.u_px, uses_chroma=True)
        return end if end and end.u_px > step.u_px else replace(tip, sd_px=COLORED_SD_PX)

    def _contrast_step(
        self, image: Image, detection: Detection, tip: TipEstimate, edges_end_px: float, rim_px: float
    ) -> TipEstimate:
        """Return the contrast step at the end of the edges or of the contrast, else the approximate tip."""
        positions_px = dict.fromkeys((min(tip.u_px, edges_end_px), tip.u_px))
        steps = (self._refine(image, detection, tip, about_px) for about_px in positions_px)
        return next((step for step in steps if step and step.u_px > rim_px), tip)

    def _before_wall(
        self, image: Image, detection: Detection, tip: TipEstimate, edges_end_px: float
    ) -> TipEstimate | None:
        """Return a tip that is visible outside the wall though something like a shaft reaches the wall."""
        strip, outside = detection.candidate.strip, replace(tip, where="outside")
        step = self._refine(image, detection, outside, min(edges_end_px, tip.u_px))
        return step if step and self._is_before_wall(strip, step.u_px, tip.u_px, edges_end_px) else None

    def _expected_step(
        self, image: Image, detection: Detection, tip: TipEstimate, expected_px: float, edges_end_px: float
    ) -> TipEstimate | None:
        """Return, of several steps, the one that was the tip before."""
        if expected_px >= tip.u_px + NEAR_PX:
            return None
        step = self._refine(image, detection, tip, expected_px)
        strip = detection.candidate.strip
        if step is None or abs(step.u_px - edges_end_px) < EDGES_END_PX:
            return step  # the edges of a bead or bubble beyond it are not in line with the shaft's
        if detection.fit.is_unbroken(step.u_px, edges_end_px) and is_bright(strip, step.u_px, edges_end_px):
            return None  # a needle comes out of its cannula
        off_px = abs(step.u_px - expected_px)
        is_end = off_px < NEAR_PX and not continues(strip, step.u_px, tip.u_px)
        return step if is_end or (off_px < CLEAR_PX and is_clear_end(strip, step, tip.u_px)) else None

    def _is_before_wall(
        self, strip: RectifiedStrip, step_px: float, tip_px: float, edges_end_px: float
    ) -> bool:
        """Return whether a step right before the wall is a tip, not a faint part of a shaft that continues.

        On known background the contrast must end there; on unknown background, where the wall may look like a
        shaft, the edges must.
        """
        gap_px = strip.wall_px - step_px
        if gap_px <= AT_WALL_PX:
            return False
        if may_reach_wall(strip, step_px):
            return tip_px <= step_px + ENDS_PX
        return edges_end_px <= step_px + EDGES_END_PX

    def _refine(
        self,
        image: Image,
        detection: Detection,
        tip: TipEstimate,
        about_px: float,
        *,
        uses_chroma: bool = False,
    ) -> TipEstimate | None:
        """Locate the contrast step about a position, and again from where it is if that is well beyond."""
        step = self._refine_once(image, detection, tip, about_px, uses_chroma)
        if step and step.u_px > about_px + CENTERED_PX:
            return self._refine_once(image, detection, tip, step.u_px, uses_chroma) or step
        return step

    def _refine_once(
        self, image: Image, detection: Detection, tip: TipEstimate, about_px: float, uses_chroma: bool
    ) -> TipEstimate | None:
        patch, blur_px = detection.candidate.patch, self._blur_px(detection)
        bevel_px = self._bevel.off_axis_px if tip.where == "inside" else 0.0
        off_axis_px = detection.fit.offset_px + detection.fit.slope * about_px
        if patch and covers_tip(patch, about_px) and abs(off_axis_px) <= MAX_OFF_AXIS_PX:
            off_px = off_axis_px + bevel_px
        else:
            patches = self._background.rectify(image, detection.line, tip_patch_px(about_px))
            patch, off_px = patches[0] if patches else None, bevel_px
        return refine_tip(patch, tip, about_px, off_px, blur_px, uses_chroma=uses_chroma) if patch else None

    def with_certainty(self, detection: Detection) -> TipEstimate:
        """Return a detection's tip with its standard deviation, and whether its place is known.

        A tip outside is not, if its shaft goes on to the wall or the wall is near: it may be in the eye. Nor
        is a tip that has just come through: it may be the wall's edge, seen where the eye has moved.
        """
        strip, tip = detection.candidate.strip, detection.tip
        is_new = not self._was_inside
        if tip.where != "inside":
            self.forget()
        if tip.where == "occluded":
            return tip
        self._was_inside = tip.where == "inside"
        judged = self._judged(detection)
        return replace(judged, is_known=False) if _may_be_in_wall(strip, tip, judged, is_new) else judged

    def _judged(self, detection: Detection) -> TipEstimate:
        tip, scale = detection.tip, self._eye.px_per_mm
        if self._judge is None:
            return replace(tip, shift_sd_px=scale * (UNJUDGED_MM if tip.contrast_grey else FAR_SD_MM))
        return self._judge.judged(detection.candidate.strip, detection.fit, tip, scale)

    def forget(self) -> None:
        """Forget how certain the tips of the last images were."""
        self._was_inside = False
        if self._judge:
            self._judge.forget()

    def before_shadow(self, image: Image, detection: Detection, tip: TipEstimate) -> TipEstimate | None:
        """Return the end of a shaft that its shadow continues, None if none does."""
        strip = detection.candidate.strip
        end = sharp_end(strip, tip) if tip.where == "inside" else None
        if end is None or _continues_colored(strip, end, tip.u_px):
            return None
        step = self._refine(image, detection, end, end.u_px)
        return step if step and abs(step.u_px - end.u_px) < SHARP_END_PX else end

    def _blur_px(self, detection: Detection) -> float:
        """Return the blur of the shaft's edges, which motion across it adds to, or else of the picture."""
        return max(detection.fit.blur_px, self._focus.blur_px)


def _doubted(step: TipEstimate, inside_px: float, expected_px: float) -> TipEstimate:
    """Return a tip outside the wall though there is contrast inside: not known, unless it was expected."""
    is_known = abs(step.u_px - expected_px) < CLEAR_PX
    return replace(step, is_known=is_known, shift_sd_px=0.0 if is_known else abs(inside_px - step.u_px))


def _shows_to_wall(strip: RectifiedStrip, edges_end_px: float) -> bool:
    """Return whether a shaft whose edges end outside shows up to the wall, or its background is unknown."""
    if not strip.outside.stop:
        return True  # the strip begins in the globe
    is_near = strip.wall_px - edges_end_px <= EDGES_END_PX
    return may_reach_wall(strip, edges_end_px) and (is_near or continues(strip, edges_end_px, strip.wall_px))


def _may_be_in_wall(strip: RectifiedStrip, tip: TipEstimate, judged: TipEstimate, is_new: bool) -> bool:
    """Return whether a tip may be in the wall or beyond it: it is too near, or its shaft goes on."""
    if tip.where == "inside":
        return is_new and judged.u_px - strip.inner_px <= AT_WALL_PX
    is_near = strip.wall_px - judged.u_px <= WALL_SD * judged.shift_sd_px
    return is_near or continues(strip, tip.u_px, strip.wall_px)


def _continues_colored(strip: RectifiedStrip, step: TipEstimate, to_px: float) -> bool:
    """Return whether a shaft continues beyond a contrast step in its colour.

    Where it becomes as bright as its ground, or from brighter to darker, its colour is what is left of it.
    """
    if to_px - step.u_px <= COLORED_PX:
        return False
    beyond = slice(*(int(strip.u_px.searchsorted(px)) for px in (step.u_px, to_px)))
    share = colored_share(strip, beyond, step.contrast_grey)
    own_share = colored_share(strip, beyond, FAINT * step.contrast_grey, own=True)
    return max(share, own_share) >= COLORED_SHARE
