"""Forceps and a second instrument, each through a trocar of its own, and the tissue they work on.

Turns an image (px) into where things are (eye frame, mm). Each shaft is followed by a `Tracker`; the jaws are
looked for along it, the tissue by its colour. Knows nothing of states, and not what the jaws hold.
"""

from msgspec.structs import replace

from haptigraph.config import PerceptionConfig
from haptigraph.geometry import Geometry, Point, Polyline, Segment, Vec, subtract, unit
from haptigraph.messages import Capture, Image, Observation
from haptigraph.perception.forceps.jaws import find_jaws
from haptigraph.perception.forceps.stained_tissue import Stains
from haptigraph.perception.needle.background import Background
from haptigraph.perception.needle.rectify import EyeGeometry
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.registration.camera import Registration

__all__ = ["ForcepsPerceiver"]

SEEN = (
    *("forceps_tip", "forceps_line", "forceps_jaws", "left_jaw", "right_jaw"),
    *("light_pipe_tip", "light_pipe_line", "membrane_edge", "hemorrhage"),
)
COVERED_MM = 4.0  # width about the shaft that is not learned as empty: jaws open no wider
BEYOND_MM = 4.0  # of where the shaft seems to end: jaws are no longer
JUST_IN_MM = 2.0  # of the trocar: no jaws can be seen yet


class ForcepsPerceiver:
    """Find forceps, light pipe, membrane edge and hemorrhage.

    Args:
        registration: Where both trocars, globe and retina lie; the forceps go through the one in use.
        config: Settings, passed on to the trackers.
    """

    sees = frozenset(SEEN)
    """Entities it may report besides the registered anatomy."""

    def __init__(self, registration: Registration, config: PerceptionConfig) -> None:
        self._registration = registration
        self._shaft = Tracker(registration, config)
        others = [
            Tracker(replace(registration, trocar=trocar), config) for trocar in registration.other_trocars
        ]
        self._pipe = others[0] if others else None
        self._stains = Stains(registration)
        eye = EyeGeometry(registration)
        self._px_per_mm, self._globe = eye.px_per_mm, (eye.center_px, eye.inner_px)
        self._background = Background(eye)

    def reset(self) -> None:
        """Forget earlier images."""
        self._background.reset()
        for tracker in (self._shaft, self._pipe):
            if tracker is not None:
                tracker.reset()

    def __call__(self, capture: Capture) -> Observation:
        """Appearance at one image.

        Raises:
            BadInput: If the image is not of the registered size.
        """
        image = self._registration.checked(capture.image)
        tissue, undyed = self._stains(image)
        found: dict[str, Geometry] = dict(self._registration.anatomy) | tissue
        capture = replace(capture, image=undyed)
        shaft = self._shaft(capture)
        pipe = self._pipe(capture).found if self._pipe else {}
        if "needle_line" in pipe:
            found |= {"light_pipe_tip": pipe["needle_tip"], "light_pipe_line": pipe["needle_line"]}
        forceps = self._forceps(image, shaft.found, found.get("light_pipe_line"))
        self._learn(image, shaft.found)
        certainty = shaft.certainty if forceps else None
        return Observation(capture.stamp_ns, found | forceps, certainty=certainty)

    def _forceps(
        self, image: Image, shaft: dict[str, Geometry], pipe: Geometry | None
    ) -> dict[str, Geometry]:
        line, tip = shaft.get("needle_line"), shaft.get("needle_tip")
        if not isinstance(line, Segment) or not isinstance(tip, Point):
            return {}
        if self._depth_mm(tip) < JUST_IN_MM:
            return {"forceps_tip": tip, "forceps_line": line}
        jaws = find_jaws(
            image,
            self._background.grey,
            self._entry_px(line),
            self._ends_px(line)[1],
            px_per_mm=self._px_per_mm,
            globe=self._globe,
            chroma_share=self._background.chroma_share,
            other=self._ends_px(pipe) if isinstance(pipe, Segment) else None,
        )
        if jaws is None:
            return {}
        one, other = (self._registration.image.to_mm(place) for place in (jaws.one_px, jaws.other_px))
        left, right = (one, other) if _is_left(one, line) else (other, one)
        middle = (left[0] + right[0]) / 2, (left[1] + right[1]) / 2
        return {
            "forceps_tip": Point(middle),
            "forceps_line": Segment(line.start_mm, middle),
            "forceps_jaws": Polyline((left, middle, right)),
            "left_jaw": Point(left),
            "right_jaw": Point(right),
        }

    def _depth_mm(self, tip: Point) -> float:
        """Return how far a tip is from the trocar towards the globe's centre; negative outside."""
        trocar_mm = self._registration.trocar.at_mm
        outwards, (x, y) = unit(trocar_mm), subtract(trocar_mm, tip.at_mm)
        return x * outwards[0] + y * outwards[1]

    def _entry_px(self, line: Segment) -> Vec:
        """Return where a shaft comes out of the wall."""
        start_px, end_px = self._ends_px(line)
        (dx, dy), (center_px, radius_px) = unit(subtract(end_px, start_px)), self._globe
        x, y = subtract(center_px, start_px)
        middle, aside = x * dx + y * dy, x * dy - y * dx
        inside = max(middle - max(radius_px**2 - aside**2, 0.0) ** 0.5, 0.0)
        return start_px[0] + inside * dx, start_px[1] + inside * dy

    def _ends_px(self, line: Segment) -> tuple[Vec, Vec]:
        to_px = self._registration.image.to_px
        return to_px(line.start_mm), to_px(line.end_mm)

    def _learn(self, image: Image, shaft: dict[str, Geometry]) -> None:
        """Learn the eye behind the jaws while they are elsewhere."""
        line, covered = shaft.get("needle_line"), None
        if isinstance(line, Segment):
            start_px, end_px = self._ends_px(line)
            along = unit(subtract(end_px, start_px))
            beyond = BEYOND_MM * self._px_per_mm
            covered = start_px, (end_px[0] + beyond * along[0], end_px[1] + beyond * along[1])
        self._background.learn(image, covered, round(COVERED_MM * self._px_per_mm))


def _is_left(place_mm: Vec, line: Segment) -> bool:
    along, to_place = subtract(line.end_mm, line.start_mm), subtract(place_mm, line.start_mm)
    return along[0] * to_place[1] - along[1] * to_place[0] > 0
