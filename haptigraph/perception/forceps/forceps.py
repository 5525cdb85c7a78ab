"""The perceiver `forceps`: forceps and a light pipe, each through its own trocar, and stained tissue.

Turns an image (px) into positions (eye frame, mm). A `Tracker` follows each shaft; the jaws are detected
along the shaft, tissue by its colour. Of forceps without visible jaws, only the shaft is reported. What the
jaws hold is not detected.
"""

from msgspec.structs import replace

from haptigraph.config import PerceptionConfig
from haptigraph.geometry import Geometry, Point, Polyline, Segment, Vec, subtract, unit
from haptigraph.messages import Capture, Image, ImageKind, Observation
from haptigraph.perception.entities import ENTITIES
from haptigraph.perception.forceps.jaws import HALF_WIDTH_MM, find_jaws
from haptigraph.perception.forceps.stained_tissue import StainedTissue
from haptigraph.perception.needle.background import Background
from haptigraph.perception.needle.rectify import EyeGeometry
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.registration.camera import Registration

__all__ = ["ForcepsPerceiver"]

PIPE_ENTITIES = {"needle_tip": "light_pipe_tip", "needle_line": "light_pipe_line"}
OCCLUDED_WIDTH_MM = 4.0  # around the shaft, excluded from the background model: jaws open no wider
BEYOND_MM = 4.0  # beyond the visible end of the shaft, excluded too: jaws are no longer
SAMPLING_PX = 3  # beyond a patch, between whose pixels it is interpolated
PIPE_EVERY = 3  # images, of which a light pipe that has not been visible for so many is searched for in one
MIN_JAW_DEPTH_MM = 2.0  # from the trocar; with less, jaws are not visible yet


class ForcepsPerceiver:
    """Find forceps, light pipe, membrane edge and hemorrhage.

    Args:
        registration: Geometry of trocars, globe and retina; the forceps enter through the trocar in use.
        config: Settings, passed on to the trackers.
    """

    images: ImageKind = "eye"
    entities = ENTITIES["forceps"]
    """Entities it may report besides the registered anatomy."""
    entities_with_sd = frozenset[str]()  # the standard deviation is that of closed jaws

    def __init__(self, registration: Registration, config: PerceptionConfig) -> None:
        self._registration = registration
        self._shaft = Tracker(registration, config, uses_network=False)
        others = [
            Tracker(replace(registration, trocar=trocar), config) for trocar in registration.other_trocars
        ]
        self._pipe = others[0] if others else None
        self._images_without_pipe = 0
        self._stains = StainedTissue(registration)
        eye = EyeGeometry(registration)
        self._px_per_mm, self._globe = eye.px_per_mm, (eye.center_px, eye.inner_px)
        self._background = Background(
            eye, reach_px=eye.inner_px + HALF_WIDTH_MM * eye.px_per_mm + SAMPLING_PX
        )

    def reset(self) -> None:
        """Forget earlier images."""
        self._background.reset()
        self._images_without_pipe = 0
        for tracker in (self._shaft, self._pipe):
            if tracker is not None:
                tracker.reset()

    def __call__(self, capture: Capture) -> Observation:
        """Process one image.

        Raises:
            BadInput: If the image is not of the registered size.
        """
        image = self._registration.checked(capture.image)
        tissue, undyed = self._stains(image)
        found: dict[str, Geometry] = dict(self._registration.anatomy) | tissue
        capture = replace(capture, image=undyed)
        shaft = self._shaft(capture)
        found |= self._light_pipe(capture)
        forceps = self._forceps(image, shaft.found, found.get("light_pipe_line"))
        self._learn(image, shaft.found)
        certainty = shaft.certainty if forceps else None
        if certainty is not None and "forceps_tip" not in forceps:
            certainty = replace(certainty, tip_sd_mm=None)
        return Observation(capture.stamp_ns, found | forceps, certainty=certainty)

    def _light_pipe(self, capture: Capture) -> dict[str, Geometry]:
        if self._pipe is None:
            return {}
        is_searched = self._images_without_pipe < PIPE_EVERY or self._images_without_pipe % PIPE_EVERY == 0
        seen = self._pipe(capture).found if is_searched else {}
        pipe = {PIPE_ENTITIES[name]: shape for name, shape in seen.items() if name in PIPE_ENTITIES}
        self._images_without_pipe = 0 if pipe else self._images_without_pipe + 1
        return pipe

    def _forceps(
        self, image: Image, shaft: dict[str, Geometry], pipe: Geometry | None
    ) -> dict[str, Geometry]:
        line, tip = shaft.get("needle_line"), shaft.get("needle_tip")
        if not isinstance(line, Segment):
            return {}
        if not isinstance(tip, Point):
            return {"forceps_line": line}
        if self._depth_mm(tip) < MIN_JAW_DEPTH_MM:
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
            return {"forceps_line": line}
        one, other = (self._registration.image.to_mm(point) for point in (jaws.one_px, jaws.other_px))
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
        """Return the distance of a tip from the trocar towards the globe's centre; negative outside."""
        trocar_mm = self._registration.trocar.at_mm
        outwards, (x, y) = unit(trocar_mm), subtract(trocar_mm, tip.at_mm)
        return x * outwards[0] + y * outwards[1]

    def _entry_px(self, line: Segment) -> Vec:
        """Return the point where a shaft emerges from the wall."""
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
        """Update the background model, except where the forceps occlude it."""
        line, occluded = shaft.get("needle_line"), None
        if isinstance(line, Segment):
            start_px, end_px = self._ends_px(line)
            along = unit(subtract(end_px, start_px))
            beyond = BEYOND_MM * self._px_per_mm
            occluded = start_px, (end_px[0] + beyond * along[0], end_px[1] + beyond * along[1])
        self._background.learn(image, occluded, round(OCCLUDED_WIDTH_MM * self._px_per_mm))


def _is_left(place_mm: Vec, line: Segment) -> bool:
    along, to_place = subtract(line.end_mm, line.start_mm), subtract(place_mm, line.start_mm)
    return along[0] * to_place[1] - along[1] * to_place[0] > 0
