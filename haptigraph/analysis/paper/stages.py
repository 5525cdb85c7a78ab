"""What the stages of both camera perceivers make of one image of a run, with what came before it.

The images are those of the recording. `threshold` and `tracker` process them from the first one on, whichever
of the two the run used.
"""

import math
from collections.abc import Iterator

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.analysis.metrics.replay import recorded_config
from haptigraph.config import PerceptionConfig
from haptigraph.errors import BadInput
from haptigraph.geometry import Point, subtract
from haptigraph.imaging import FloatImage, Floats, tilt_corrected
from haptigraph.messages import Capture, Image
from haptigraph.perception.baseline.threshold import ThresholdPerceiver, ThresholdStages
from haptigraph.perception.needle.background import Background
from haptigraph.perception.needle.rectify import EyeGeometry
from haptigraph.perception.needle.search import PolarSearch
from haptigraph.perception.needle.tip_selection import Detection
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress
from haptigraph.registration.camera import Registration

__all__ = ["FilterTrace", "SearchStage", "Stages", "read_stages"]

BEFORE_S = 2.0
"""How much of the past the filters show."""


class SearchStage(Struct, frozen=True, eq=False):
    """The polar search as it would acquire the needle in this image."""

    angles_deg: Floats
    """Between each line and the direction from the trocar to the globe's centre, (n,)."""
    scores: FloatImage
    """How much each line looks like a needle, (n,) [cells]."""
    candidates_deg: list[float]
    """Angles of the candidates, best first."""


class FilterTrace(Struct):
    """What a filter made of the images up to this one."""

    time_s: list[float] = []
    """Since the first step of the run."""
    measured_mm: list[float] = []
    """Depth of the tip beyond the trocar in each image alone; nan if it was not measured."""
    filtered_mm: list[float] = []
    sd_mm: list[float] = []
    """Reported standard deviation; nan if there is none."""


class Stages(Struct, eq=False):
    """One image in every stage."""

    image: Image
    """As recorded."""
    frontal: Image
    """Without the camera's tilt; this is what perception sees."""
    time_s: float
    threshold: ThresholdStages
    average: FilterTrace
    search: SearchStage
    detection: Detection
    pose: FilterTrace


class _Runner:
    """Both perceivers, each twice: measured in one image alone, and filtered."""

    def __init__(self, registration: Registration, config: PerceptionConfig) -> None:
        self._registration = registration
        self.alone = ThresholdPerceiver(registration, replace(config, alpha=1.0))
        self._average = ThresholdPerceiver(registration, config)
        self._tracker, self._filtered = Tracker(registration, config), Tracker(registration, config)
        self.average, self.pose = FilterTrace(), FilterTrace()

    def add(self, capture: Capture, time_s: float) -> Detection | None:
        """Process the next image; return what the tracker measures in it alone."""
        if capture.image is None:
            return None
        alone, average = self.alone(capture), self._average(capture)
        detection = self._tracker.detect(capture.image, capture.stamp_ns)
        filtered = self._filtered(capture)
        measured_mm, averaged_mm = (self._depth_mm(each.found.get("needle_tip")) for each in (alone, average))
        _append(self.average, time_s, measured_mm, averaged_mm, math.nan)
        is_known = detection is not None and detection.tip.is_known
        measured_mm = (
            detection.tip.u_px * self._registration.image.mm_per_px if detection and is_known else math.nan
        )
        sd_mm = filtered.certainty.tip_sd_mm if filtered.certainty else None
        depth_mm = self._depth_mm(filtered.found.get("needle_tip"))
        _append(self.pose, time_s, measured_mm, depth_mm, math.nan if sd_mm is None else sd_mm)
        return detection

    def _depth_mm(self, tip: object) -> float:
        """Return how far a tip is beyond the trocar; nan if there is none."""
        if not isinstance(tip, Point):
            return math.nan
        return math.hypot(*subtract(tip.at_mm, self._registration.trocar.at_mm))


def _append(trace: FilterTrace, time_s: float, measured_mm: float, filtered_mm: float, sd_mm: float) -> None:
    trace.time_s.append(time_s)
    trace.measured_mm.append(measured_mm)
    trace.filtered_mm.append(filtered_mm)
    trace.sd_mm.append(sd_mm)


def read_stages(
    reader: RunReader, registration: Registration, number: int, progress: Progress | None = None
) -> Stages:
    """Process the images of a recording up to one step, and return every stage of that one.

    Args:
        reader: The recording.
        registration: The static anatomy.
        number: The step, from 0.
        progress: Called with the progress.

    Raises:
        BadInput: If the step has no image, or no needle is detected in it.
    """
    frontal = registration.frontal
    runner = _Runner(frontal, recorded_config(reader).perception)
    start_ns: int | None = None
    for place, capture in enumerate(_captures(reader)):
        start_ns = capture.stamp_ns if start_ns is None else start_ns
        time_s = (capture.stamp_ns - start_ns) / 1e9
        if progress is not None:
            progress("processing images", place, number + 1)
        raw = capture.image
        if raw is not None and registration.image.frontal_from_image:
            corrected = tilt_corrected(registration.checked(raw), registration.image.frontal_from_image)
            capture = replace(capture, image=corrected)
        detection = runner.add(capture, time_s)
        if place == number:
            break
    if raw is None or capture.image is None or detection is None or detection.tip.where == "occluded":
        problem = f"no needle is detected in an image at {time_s:.2f} s; choose another time with --at"
        raise BadInput(problem, reader.path)
    return Stages(
        *(raw, capture.image, time_s, runner.alone.stages(capture.image), _last(runner.average)),
        *(_search(frontal, capture.image), detection, _last(runner.pose)),
    )


def _captures(reader: RunReader) -> Iterator[Capture]:
    return (capture for capture, _ in reader.records())


def _last(trace: FilterTrace) -> FilterTrace:
    """Return the last part of a trace."""
    first = next(n for n, time_s in enumerate(trace.time_s) if time_s >= trace.time_s[-1] - BEFORE_S)
    return FilterTrace(
        trace.time_s[first:], trace.measured_mm[first:], trace.filtered_mm[first:], trace.sd_mm[first:]
    )


def _search(registration: Registration, image: Image) -> SearchStage:
    eye = EyeGeometry(registration)
    background, search = Background(eye, registration.background), PolarSearch(eye)
    background.measure_light(image)
    setting = background.chroma_share, background.light
    lines = search.search(image, *setting)
    return SearchStage(
        np.degrees(search.angles_rad - eye.inwards_rad),
        search.scores(image, *setting)[0],
        [math.degrees(line.angle_rad - eye.inwards_rad) for line in lines],
    )
