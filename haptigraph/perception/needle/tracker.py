"""The tracker: needle poses from a thin strip of the image, as precise as its noise permits.

Turns an image (px) into a needle (eye frame, mm) with standard deviations. It follows a needle in a strip
along the expected shaft, and searches for one at all angles otherwise. What is not known is not reported: of
a needle whose tip may be elsewhere, only the shaft; of one whose tip the wall occludes, nothing, because the
stub outside looks like an empty port. `Tracker.detect` runs the stages, one module each:

stage              module          computes
predict            pose_filter     the expected line and tip, from earlier images
focus              focus           how blurred it is, in every 16th image
search             search          candidate lines, if no needle is tracked or it was lost
visible globe      visible_globe   whether there is an eye at all, before a needle is acquired
rectify            rectify         the strip along a line, and a tip patch, less the background
coarse tip         coarse_tip      how far there is contrast along the strip
shaft line         shaft_line      the shaft's middle line, from its edges
tip selection      tip_selection   which contrast step along the shaft is the tip
sub-pixel tip      subpixel_tip    the position of each such step (`refine_tip`)
certainty          tip_network     where the tip is most probably, and whether it may be elsewhere
filter             pose_filter     the pose, from prediction and measurement
background update  background      the eye without the needle
"""

import math
from collections.abc import Iterable

from msgspec.structs import replace

from haptigraph.config import PerceptionConfig
from haptigraph.geometry import Geometry, Point, Segment, Vec
from haptigraph.imaging import FloatImage
from haptigraph.messages import Capture, Certainty, Fault, Image, ImageKind, Observation
from haptigraph.perception.entities import ENTITIES
from haptigraph.perception.needle.background import Background, occluded_ends
from haptigraph.perception.needle.bevel import Bevel
from haptigraph.perception.needle.coarse_tip import EXPOSED_MM, Cannulas, estimate_coarse_tip
from haptigraph.perception.needle.focus import Focus
from haptigraph.perception.needle.pose_filter import PoseFilter
from haptigraph.perception.needle.rectify import MAX_TURN_RAD, EyeGeometry, Line, RectifiedStrip, stations
from haptigraph.perception.needle.search import PolarSearch
from haptigraph.perception.needle.shaft_line import NEW, Appearance, LineFit, fit_line
from haptigraph.perception.needle.subpixel_tip import tip_patch_px
from haptigraph.perception.needle.tip_selection import MAX_OFF_AXIS_PX, Candidate, Detection, TipSelector
from haptigraph.perception.needle.visible_globe import VisibleGlobe
from haptigraph.registration.camera import Registration

__all__ = ["Tracker", "detections_in"]

AHEAD_MM = 2.5  # of the strip beyond the expected tip
BEHIND_MM = 14.0  # of the strip before it
AHEAD_OF_TIP_MM = 0.3  # not learned as background
MAX_MISS_MM = 1.5  # of a needle from the registered trocar
OFF_AXIS_MM = -1.2, -0.8, -0.4, 0.4, 0.8, 1.2  # offsets of lines that are searched beside the trocar
TRACKED_PX = 8.0  # between the expected and the actual shaft
REPEATED_PX = 2.0  # between a line and the one that is measured again along it
MIN_CONFIDENCE, MIN_OFF_AXIS_CONFIDENCE = 0.4, 0.7
MAX_DOUBTS = 15  # images with something like a needle that is none, until it counts as background
MAX_WIDTH_MM = 1.0
MAX_ELAPSED_S = 0.2
CONTRAST_RATE = 0.1
PATCH_MARGIN_PX = 6  # of a tip patch, for the prediction may be wrong
INTERVAL_NS = 33_000_000  # between images picked from a clip: a needle that has moved too far is searched
NO_EYE = Fault(
    "registration",
    "the rim of the eye is not visible where it was registered, so no needle is reported; register again",
)


class Tracker:
    """Track the needle.

    Args:
        registration: The static anatomy.
        config: Settings; none is used so far, but all perceivers receive them.
        uses_network: Whether the tip network judges the tip; it has learned needles, and no jaws.
    """

    images: ImageKind = "eye"
    entities = ENTITIES["tracker"]
    entities_with_sd = entities
    """Entities it may report besides the registered anatomy."""

    def __init__(
        self, registration: Registration, config: PerceptionConfig, *, uses_network: bool = True
    ) -> None:
        self._registration = registration
        self._eye = EyeGeometry(registration)
        self._pose = PoseFilter(self._eye.px_per_mm)
        self._polar_search = PolarSearch(self._eye)
        self._off_axis_search = PolarSearch(self._eye, OFF_AXIS_MM, until_mm=0.0)
        self._is_globe_visible = VisibleGlobe(self._eye)
        self._background = Background(self._eye, registration.background)
        self._bevel = Bevel()
        self._focus = Focus(self._eye)
        self._cannulas = Cannulas(self._eye.px_per_mm)
        models = self._background, self._bevel, self._focus
        self._tip_selector = TipSelector(self._eye, *models, uses_network=uses_network)
        self.reset()

    def reset(self) -> None:
        """Forget earlier images."""
        self._background.reset()
        self._pose.reset()
        self._focus.reset()
        self._cannulas.reset()
        self._usual_grey: float | None = None
        self._update_filter(None)
        self._doubts = 0
        self._stamp_ns: int | None = None
        self._is_eye_visible = True

    def __call__(self, capture: Capture) -> Observation:
        """Observe the needle in one image.

        Raises:
            BadInput: If the image is not of the registered size.
        """
        detection = self.detect(self._registration.checked(capture.image), capture.stamp_ns)
        found: dict[str, Geometry] = dict(self._registration.anatomy)
        if detection is None or detection.tip.where == "occluded":
            return Observation(capture.stamp_ns, found, () if self._is_eye_visible else (NO_EYE,))
        needle = self._needle() if detection.tip.is_known else self._shaft(detection)
        return Observation(capture.stamp_ns, found | needle, certainty=self._certainty(detection))

    def detect(self, image: Image, stamp_ns: int) -> Detection | None:
        """Process one image; return what was measured in it alone, None if there is no needle."""
        self._is_eye_visible = True
        self._focus.measure(image)
        expected = self._predict(stamp_ns)
        detection = self._track(image, *expected) if expected else None
        if detection is None:
            self._pose.lose()
            detection = self._search(image) or self._search_off_axis(image)
        self._update_filter(detection)
        self._update_background(image, detection)
        return detection

    def _predict(self, stamp_ns: int) -> tuple[Line, float] | None:
        """Predict the line and the tip's depth along it; None if no needle is tracked."""
        before_ns, self._stamp_ns = self._stamp_ns, stamp_ns
        if before_ns is None or not self._pose.is_tracking:
            return None
        return self._pose.predict(min(max((stamp_ns - before_ns) / 1e9, 0.0), MAX_ELAPSED_S))

    def _track(self, image: Image, expected: Line, depth_px: float) -> Detection | None:
        """Measure the needle in a strip along the expected line."""
        until_px = depth_px + AHEAD_MM * self._eye.px_per_mm
        from_px = depth_px - BEHIND_MM * self._eye.px_per_mm
        patch_px = tip_patch_px(depth_px, PATCH_MARGIN_PX)
        candidate = self._candidate(image, expected, from_px, until_px, patch_px, depth_px)
        detection = self._fit_shaft_line(candidate, TRACKED_PX)
        if detection is None:
            return None
        if detection.tip.u_px > until_px - self._eye.px_per_mm or detection.off_axis_px > MAX_OFF_AXIS_PX:
            detection = self._measured_again(image, detection, from_px) or detection
        return self._select_tip(image, detection, depth_px)

    def _search(self, image: Image) -> Detection | None:
        """Search for a needle in its trocar."""
        self._background.measure_light(image)
        lines = self._polar_search.search(image, self._background.chroma_share, self._background.light)
        self._doubts = self._doubts + 1 if lines else MAX_DOUBTS
        return self._best(image, lines)

    def _search_off_axis(self, image: Image) -> Detection | None:
        """Search for a needle that points beside its trocar; what reaches the wall there is none."""
        lines = self._off_axis_search.search(image, self._background.chroma_share, self._background.light)
        detection = self._best(image, lines)
        if detection is None or detection.tip.where != "outside":
            return None
        return detection if detection.fit.confidence >= MIN_OFF_AXIS_CONFIDENCE else None

    def _best(self, image: Image, lines: list[Line]) -> Detection | None:
        """Measure the needle along the candidate line with the most evidence that proves to be one."""
        candidates = [candidate for line in lines if (candidate := self._candidate(image, line))]
        for candidate in sorted(candidates, key=lambda candidate: -candidate.tip.evidence_px):
            detection = self._fit_shaft_line(candidate, candidate.strip.half_px)
            if detection is not None:
                return self._acquired(image, detection)
        self._cannulas.learn((candidate.strip, candidate.tip) for candidate in candidates)
        return None

    def _acquired(self, image: Image, detection: Detection) -> Detection | None:
        """Measure a new needle again: before any background is known, it must prove to be one twice."""
        self._is_eye_visible = self._is_globe_visible(image)
        if not self._is_eye_visible:
            return None
        again = self._measured_again(image, detection)
        if self._background.is_new and (again is None or again.is_adrift(self._eye.px_per_mm)):
            return None
        return self._select_tip(image, again or detection)

    def _measured_again(
        self, image: Image, detection: Detection, from_px: float = -math.inf
    ) -> Detection | None:
        """Measure the needle again along its own line; the first strip was a little off."""
        patch_px = tip_patch_px(detection.tip.u_px, PATCH_MARGIN_PX)
        candidate = self._candidate(image, detection.line, from_px, patch_px=patch_px)
        return self._fit_shaft_line(candidate, REPEATED_PX)

    def _candidate(
        self,
        image: Image,
        expected: Line,
        from_px: float = -math.inf,
        until_px: float = math.inf,
        patch_px: FloatImage | None = None,
        tracked_px: float = -math.inf,
    ) -> Candidate | None:
        """Rectify the image along an expected line and estimate the tip of something like a needle."""
        rectified = self._rectify(image, expected, from_px, until_px, patch_px)
        if rectified is None:
            return None
        strip, patch = rectified
        tip = estimate_coarse_tip(strip, self._eye.px_per_mm, self._usual_grey, tracked_px)
        return Candidate(expected, strip, patch, tip) if tip else None

    def _rectify(
        self, image: Image, line: Line, from_px: float, until_px: float, patch_px: FloatImage | None
    ) -> tuple[RectifiedStrip, RectifiedStrip | None] | None:
        """Return the strip along a line, less the background, and the tip patch; None beside the globe."""
        u_px = stations(self._eye, line, from_px, until_px)
        if u_px is None:
            return None
        strips = self._background.rectify(image, line, *((u_px,) if patch_px is None else (u_px, patch_px)))
        return (strips[0], None if patch_px is None else strips[1]) if strips else None

    def _fit_shaft_line(self, candidate: Candidate | None, miss_px: float) -> Detection | None:
        """Fit the shaft's line; None if it is no needle."""
        if candidate is None or self._cannulas.include(candidate.strip, candidate.tip):
            return None
        fit = fit_line(candidate.strip, candidate.tip.u_px, miss_px, self._appearance)
        if fit is None:
            return None
        expected = candidate.expected
        line = Line(expected.angle_rad + math.atan(fit.slope), expected.offset_px + fit.offset_px)
        return Detection(candidate, line, fit, candidate.tip) if self._is_needle(line, fit) else None

    def _is_needle(self, line: Line, fit: LineFit) -> bool:
        scale = self._eye.px_per_mm
        turn_rad = math.remainder(line.angle_rad - self._eye.inwards_rad, 2 * math.pi)
        blur_px = 2 * fit.blur_px if self._pose.is_tracking else 0.0  # of both edges
        return (
            fit.confidence >= MIN_CONFIDENCE
            and abs(line.offset_px) <= MAX_MISS_MM * scale
            and abs(turn_rad) <= MAX_TURN_RAD
            and fit.width_px <= MAX_WIDTH_MM * scale + blur_px
        )

    def _select_tip(self, image: Image, detection: Detection, expected_px: float = math.inf) -> Detection:
        """Select the tip and locate it sub-pixel; what continues beyond the shaft's edges is its shadow."""
        selected = self._select_end(image, detection, expected_px)
        tip = self._tip_selector.with_certainty(selected)
        return replace(selected, tip=replace(tip, is_known=tip.is_known and not self._cannulas.may_hide(tip)))

    def _select_end(self, image: Image, detection: Detection, expected_px: float) -> Detection:
        tip = self._tip_selector.select(image, detection, expected_px)
        end = self._tip_selector.before_shadow(image, detection, tip)
        if end is None:
            return replace(detection, tip=tip)
        candidate = detection.candidate
        without_shadow = self._fit_shaft_line(replace(candidate, tip=end), candidate.strip.half_px)
        return without_shadow or replace(detection, tip=end)

    def _update_filter(self, detection: Detection | None) -> None:
        """Update the pose, and what the needle's appearance has shown."""
        if detection is None:
            self._appearance: Appearance = NEW
            self._bevel.reset()
            self._tip_selector.forget()
            return
        tip, fit, candidate = detection.tip, detection.fit, detection.candidate
        if tip.where == "inside" and tip.is_known:
            self._bevel.learn(candidate.strip, tip.u_px, fit)
        if tip.where == "inside" and tip.contrast_grey:
            before = tip.contrast_grey if self._usual_grey is None else self._usual_grey
            self._usual_grey = before + CONTRAST_RATE * (tip.contrast_grey - before)
        self._appearance = fit.appearance
        is_in_trocar = tip.where != "outside"
        sd_px = tip.sd_px if tip.is_known else max(tip.sd_px, tip.shift_sd_px)
        self._pose.update(detection.line, fit.covariance, tip.u_px, sd_px, is_in_trocar)

    def _update_background(self, image: Image, detection: Detection | None) -> None:
        """Update the background model with what the needle does not occlude."""
        if detection is None and self._background.is_new and self._doubts < MAX_DOUBTS:
            return  # what may be a needle must not become background
        occluded = None if detection is None else self._occluded_ends(detection)
        self._background.learn(image, occluded, 2 * self._eye.half_px)

    def _occluded_ends(self, detection: Detection) -> tuple[Vec, Vec]:
        line, tip, coarse = detection.line, detection.tip, detection.candidate.tip
        end_px = max(tip.u_px, coarse.u_px) if tip.where == "inside" else tip.u_px
        until_px = end_px + AHEAD_OF_TIP_MM * self._eye.px_per_mm
        if not (tip.contrast_grey and until_px > -EXPOSED_MM * self._eye.px_per_mm):
            until_px = max(until_px, 0.0)  # it may continue into the wall, which occludes it
        return occluded_ends(self._eye, line, until_px)

    def _needle(self) -> dict[str, Geometry]:
        line, depth_px, off_axis_px = self._pose.line, self._pose.depth_px, self._bevel.off_axis_px
        (x, y), (nx, ny) = line.at_px(self._eye.trocar_px, depth_px), line.normal
        tip_px = x + off_axis_px * nx, y + off_axis_px * ny
        return {"needle_tip": Point(self._registration.image.to_mm(tip_px)), **self._line_to(depth_px)}

    def _shaft(self, detection: Detection) -> dict[str, Geometry]:
        """Return the shaft as far as both its edges are visible: it may go on, so its end is no tip."""
        return self._line_to(min(detection.edges_end_px, detection.tip.u_px))

    def _line_to(self, end_px: float) -> dict[str, Geometry]:
        line, trocar_px, to_mm = self._pose.line, self._eye.trocar_px, self._registration.image.to_mm
        start_px = 0.0 if end_px > 0 else end_px - self._eye.px_per_mm
        start, end = line.at_px(trocar_px, start_px), line.at_px(trocar_px, end_px)
        return {"needle_line": Segment(to_mm(start), to_mm(end))}

    def _certainty(self, detection: Detection) -> Certainty:
        tip_sd_px = self._pose.tip_sd_px(detection.tip.shift_sd_px)
        return Certainty(
            confidence=detection.fit.confidence,
            tip_sd_mm=tip_sd_px / self._eye.px_per_mm if detection.tip.is_known else None,
            theta_sd_deg=math.degrees(math.hypot(self._pose.angle_sd_rad, detection.fit.light_rad)),
        )


def detections_in(images: Iterable[Image], registration: Registration) -> list[Detection | None]:
    """Return what a tracker measures in each of some images of one clip, in order.

    Args:
        images: Without tilt; they may be far apart.
        registration: The static anatomy.
    """
    tracker = Tracker(registration, PerceptionConfig())
    return [tracker.detect(image, number * INTERVAL_NS) for number, image in enumerate(images)]
