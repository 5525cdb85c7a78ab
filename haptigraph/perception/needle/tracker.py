"""The tracker: exact needle poses from a thin strip of the image, limited by its noise.

Turns an image (px) into where things are (eye frame, mm), with standard deviations. Without a needle in
hand it searches the angles at which one can leave the trocar; with one it looks at a strip about the
expected shaft. What cannot be seen is not reported: a tip in the wall, a needle that has gone. Knows
nothing of states.
"""

import math
from collections.abc import Iterable

from msgspec.structs import replace

from haptigraph.config import PerceptionConfig
from haptigraph.geometry import Geometry, Point, Segment
from haptigraph.imaging import FloatImage
from haptigraph.messages import Capture, Certainty, Image, Observation
from haptigraph.perception.needle.background import Background, occluded_ends
from haptigraph.perception.needle.bevel import Bevel
from haptigraph.perception.needle.coarse_tip import estimate_coarse_tip
from haptigraph.perception.needle.pose_filter import PoseFilter
from haptigraph.perception.needle.rectify import LARGEST_TURN_RAD, Line, Site, stations
from haptigraph.perception.needle.search import PolarSearch
from haptigraph.perception.needle.shaft_line import NEW, Appearance, LineFit, fit_line
from haptigraph.perception.needle.subpixel_tip import tip_patch_px
from haptigraph.perception.needle.tip_selection import OFF_PX, Candidate, Detection, TipSelector
from haptigraph.registration.camera import Registration

__all__ = ["Tracker", "detections_in"]

AHEAD_MM = 2.5  # how far the tip may be beyond where it is expected
EXPOSED_MM = 2.0  # before the trocar: a tip seen there is the end, and the ground ahead is free
AHEAD_OF_TIP_MM = 0.3  # not learned as background
BEHIND_MM = 14.0  # how much of the shaft is looked at
MISS_MM = 1.5  # a needle passes the registered trocar no further off
BESIDE_MM = -1.2, -0.8, -0.4, 0.4, 0.8, 1.2  # where lines beside it pass that are searched
TRACKED_PX = 8.0  # between the expected and the real shaft
LEAST_CONFIDENCE, BESIDE_CONFIDENCE = 0.4, 0.7
DOUBTS = 15  # images with something like a needle that is none, until it counts as background
AGAIN_PX = 2.0  # between a line and what is found in a second look along it
THICKEST_MM = 1.0
LONGEST_STEP_S = 0.2
CONTRAST_RATE = 0.1
APART_NS = 33_000_000  # of images picked from a clip: a needle that is not where it was is searched
CLOSEUP_SPARE_PX = 6  # beyond a close-up of the tip, for where the tip is may be expected wrongly


class Tracker:
    """Find the needle.

    Args:
        registration: Where trocar and globe lie.
        config: Settings; none is needed so far, but all perceivers are given them.
    """

    needs_scan = False
    entities = frozenset(("needle_tip", "needle_line"))
    """Entities it may report besides the registered anatomy."""

    def __init__(self, registration: Registration, config: PerceptionConfig) -> None:
        self._registration = registration
        self._site = Site(registration)
        self._search = PolarSearch(self._site)
        self._search_off_axis = PolarSearch(self._site, BESIDE_MM, until_mm=0.0)
        self._background = Background(self._site, registration.background)
        self._bevel = Bevel()
        self._select_tip = TipSelector(self._site, self._background, self._bevel)
        self._pose = PoseFilter(self._site.px_per_mm)
        self.reset()

    def reset(self) -> None:
        """Forget earlier images."""
        self._background.reset()
        self._pose.reset()
        self._bevel.reset()
        self._usual_grey: float | None = None
        self._look: Appearance = NEW
        self._doubts = 0
        self._stamp_ns: int | None = None

    def __call__(self, capture: Capture) -> Observation:
        """Appearance at one image.

        Raises:
            BadInput: If the image is not of the registered size.
        """
        sight = self.look(self._registration.checked(capture.image), capture.stamp_ns)
        found: dict[str, Geometry] = dict(self._registration.anatomy)
        if sight is None or sight.reach.where == "hidden":
            return Observation(capture.stamp_ns, found)
        return Observation(capture.stamp_ns, found | self._needle(), certainty=self._certainty(sight))

    def look(self, image: Image, stamp_ns: int) -> Detection | None:
        """Take in one image; return what was measured in it alone, None if there is no needle."""
        sight = self._track(image, stamp_ns)
        if sight is None:
            self._pose.lose()
            sight = self._acquire(image)
        self._learn(image, sight)
        if sight is None:
            self._look = NEW
            self._bevel.reset()
            return None
        self._learn_bevel(sight)
        reach, self._look = sight.reach, sight.fit.look
        is_pivoting = reach.where != "outside"
        self._pose.update(sight.line, sight.fit.covariance, reach.tip_px, reach.sd_px, is_pivoting)
        return sight

    def _track(self, image: Image, stamp_ns: int) -> Detection | None:
        before_ns, self._stamp_ns = self._stamp_ns, stamp_ns
        if before_ns is None or not self._pose.is_tracking:
            return None
        seconds = min(max((stamp_ns - before_ns) / 1e9, 0.0), LONGEST_STEP_S)
        expected, depth_px = self._pose.predict(seconds)
        until_px = depth_px + AHEAD_MM * self._site.px_per_mm
        from_px = depth_px - BEHIND_MM * self._site.px_per_mm
        near_px = tip_patch_px(depth_px, CLOSEUP_SPARE_PX)
        glimpse = self._glimpse(image, expected, from_px, until_px, near_px, depth_px)
        sight = self._measured(glimpse, TRACKED_PX) if glimpse else None
        if sight is None:
            return None
        if sight.reach.tip_px > until_px - self._site.px_per_mm or sight.off_px > OFF_PX:
            sight = self._second_look(image, sight, from_px)
        return self._refined(image, sight, depth_px)

    def _acquire(self, image: Image) -> Detection | None:
        self._background.look(image)
        candidates = self._candidates(self._search, image)
        self._doubts = self._doubts + 1 if candidates else DOUBTS
        return self._best(image, candidates) or self._acquire_off_axis(image)

    def _acquire_off_axis(self, image: Image) -> Detection | None:
        """Find a needle that points beside its trocar; of what reaches the wall there, none is."""
        sight = self._best(image, self._candidates(self._search_off_axis, image))
        is_sure = sight and sight.reach.where == "outside" and sight.fit.confidence >= BESIDE_CONFIDENCE
        return sight if is_sure else None

    def _candidates(self, fan: PolarSearch, image: Image) -> list[Line]:
        return fan.search(image, self._background.chroma_share, self._background.light)

    def _best(self, image: Image, candidates: list[Line]) -> Detection | None:
        glimpses = [seen for line in candidates if (seen := self._glimpse(image, line)) is not None]
        for glimpse in sorted(glimpses, key=lambda seen: -seen.reach.evidence_px):
            sight = self._measured(glimpse, glimpse.strip.half_px)
            if sight is not None:
                return self._refined(image, self._second_look(image, sight))
        return None

    def _second_look(self, image: Image, sight: Detection, from_px: float = -math.inf) -> Detection:
        """Appearance again where the needle was found to be; the first look was a little off."""
        near_px = tip_patch_px(sight.reach.tip_px, CLOSEUP_SPARE_PX)
        glimpse = self._glimpse(image, sight.line, from_px, near_px=near_px)
        return (self._measured(glimpse, AGAIN_PX) if glimpse else None) or sight

    def _glimpse(
        self,
        image: Image,
        expected: Line,
        from_px: float = -math.inf,
        until_px: float = math.inf,
        near_px: FloatImage | None = None,
        followed_px: float = -math.inf,
    ) -> Candidate | None:
        """Appearance along an expected line for something like a needle, and how far it reaches, roughly."""
        u_px = stations(self._site, expected, from_px, until_px)
        if u_px is None:
            return None
        runs = (u_px,) if near_px is None else (u_px, near_px)
        strips = self._background.strips(image, expected, *runs)
        if strips is None:
            return None
        reach = estimate_coarse_tip(strips[0], self._site.px_per_mm, self._usual_grey, followed_px)
        return (
            Candidate(expected, strips[0], strips[-1] if near_px is not None else None, reach)
            if reach
            else None
        )

    def _measured(self, glimpse: Candidate, miss_px: float) -> Detection | None:
        """Fit the shaft's line; None if it is no needle."""
        fit = fit_line(glimpse.strip, glimpse.reach.tip_px, miss_px, self._look)
        if fit is None:
            return None
        expected = glimpse.expected
        line = Line(expected.angle_rad + math.atan(fit.slope), expected.offset_px + fit.offset_px)
        return Detection(glimpse, line, fit, glimpse.reach) if self._is_needle(line, fit) else None

    def _refined(self, image: Image, sight: Detection, expected_px: float = math.inf) -> Detection:
        """Appearance at the tip closely, first where the shaft's edges end: the rest may be its shadow."""
        reach = self._select_tip(image, sight, expected_px)
        end = self._select_tip.before_shadow(image, sight, reach)
        if end is None:
            return replace(sight, reach=self._select_tip.dim_point(image, sight, reach) or reach)
        without_shadow = self._measured(replace(sight.glimpse, reach=end), sight.glimpse.strip.half_px)
        return without_shadow or replace(sight, reach=end)

    def _is_needle(self, line: Line, fit: LineFit) -> bool:
        scale = self._site.px_per_mm
        turn_rad = math.remainder(line.angle_rad - self._site.inwards_rad, 2 * math.pi)
        return (
            fit.confidence >= LEAST_CONFIDENCE
            and abs(line.offset_px) <= MISS_MM * scale
            and abs(turn_rad) <= LARGEST_TURN_RAD
            and fit.width_px <= THICKEST_MM * scale
        )

    def _learn(self, image: Image, sight: Detection | None) -> None:
        if sight is None and self._background.is_new and self._doubts < DOUBTS:
            return  # what may be a needle must not become background
        needle = None
        if sight is not None:
            if sight.reach.where == "inside" and sight.reach.contrast_grey:
                now = sight.reach.contrast_grey
                before = now if self._usual_grey is None else self._usual_grey
                self._usual_grey = before + CONTRAST_RATE * (now - before)
            scale = self._site.px_per_mm
            until_px = sight.reach.tip_px + AHEAD_OF_TIP_MM * scale
            if not (sight.reach.contrast_grey and until_px > -EXPOSED_MM * scale):
                until_px = max(until_px, 0.0)  # it may go on; in the wall nothing shows
            needle = occluded_ends(self._site, sight.line, until_px)
        self._background.learn(image, needle, 2 * self._site.half_px)

    def _learn_bevel(self, sight: Detection) -> None:
        strip, closeup = sight.glimpse.strip, sight.glimpse.closeup
        if closeup is not None and sight.reach.where == "inside":
            self._bevel.learn(strip, closeup, sight.reach.tip_px, sight.fit)

    def _needle(self) -> dict[str, Geometry]:
        line, to_mm = self._pose.line, self._registration.image.to_mm
        (x, y), (nx, ny) = line.at_px(self._site.trocar_px, self._pose.depth_px), line.normal
        aside_px = self._bevel.aside_px
        start_px = 0.0 if self._pose.depth_px > 0 else self._pose.depth_px - self._site.px_per_mm
        entry = to_mm(line.at_px(self._site.trocar_px, start_px))
        return {
            "needle_tip": Point(to_mm((x + aside_px * nx, y + aside_px * ny))),
            "needle_line": Segment(entry, to_mm((x, y))),
        }

    def _certainty(self, sight: Detection) -> Certainty:
        return Certainty(
            confidence=sight.fit.confidence,
            tip_sd_mm=self._pose.tip_sd_px() / self._site.px_per_mm,
            theta_sd_deg=math.degrees(self._pose.angle_sd_rad),
        )


def detections_in(images: Iterable[Image], registration: Registration) -> list[Detection | None]:
    """Return what a tracker measures in each of some images of one clip, in order.

    Args:
        images: Without slant; they may lie far apart.
        registration: Where the anatomy lies in them.
    """
    tracker = Tracker(registration, PerceptionConfig())
    return [tracker.look(image, number * APART_NS) for number, image in enumerate(images)]
