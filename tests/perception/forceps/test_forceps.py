"""Forceps, light pipe, membrane and blood in the images of the golden run, against its ground truth."""

import math

import numpy as np
import pytest
from msgspec.structs import replace
from paths import GOLDEN

from haptigraph.config import PerceptionConfig
from haptigraph.geometry import Circle, Point, Polyline
from haptigraph.messages import Capture
from haptigraph.perception.forceps.forceps import ForcepsPerceiver
from haptigraph.recording.reader import RunReader
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario
from haptigraph.sources.phantom import capture_of

RUN = GOLDEN / "membrane_peeling.mcap"
COLLISION_S = (21.0, 24.0)


@pytest.fixture(scope="module")
def detections():
    """Time, ground truth and detections of every capture with an image."""
    reader = RunReader(RUN)
    perceive = ForcepsPerceiver(parse_registration(reader.info.registration, "run"), PerceptionConfig())
    captures = [capture for capture, _ in reader.records() if capture.image is not None]
    first_ns = captures[0].stamp_ns
    captures_without_truth = [replace(capture, truth=None) for capture in captures]
    results = [perceive(capture) for capture in captures_without_truth]
    perceive.reset()
    assert [perceive(capture) for capture in captures_without_truth] == results
    return [((c.stamp_ns - first_ns) / 1e9, c.truth, o.found) for c, o in zip(captures, results, strict=True)]


def errors_mm(detections, name: str, min_depth_mm: float = 4.0) -> list[float]:
    return [
        math.dist(found[name].at_mm, truth.others[name].at_mm) if name in found else math.inf
        for time_s, truth, found in detections
        if truth.depth_mm > min_depth_mm and not COLLISION_S[0] < time_s < COLLISION_S[1]
    ]


@pytest.mark.parametrize("name", ["forceps_tip", "left_jaw", "right_jaw", "membrane_edge", "light_pipe_tip"])
def test_tips_and_edge_are_accurate_to_three_pixels(detections, name):
    errors = errors_mm(detections, name)
    assert len(errors) > 70
    assert np.percentile(errors, 90) < 3 / 8.8
    assert np.median(errors) < 1 / 8.8


def test_opening_and_closing_of_the_jaws_is_detected(detections):
    counted = agreed = 0
    for _, truth, found in detections:
        if "left_jaw" not in found or truth.depth_mm < 4:
            continue
        opening = [math.dist(at["left_jaw"].at_mm, at["right_jaw"].at_mm) for at in (truth.others, found)]
        if not 0.5 < opening[0] < 0.9:  # on the way
            counted += 1
            agreed += (opening[0] > 0.7) == (opening[1] > 0.7)
    assert counted > 80
    assert agreed >= counted - 2


def test_jaws_are_reported_together_or_not_at_all_and_no_tip_without_its_shaft(detections):
    for _, truth, found in detections:
        assert "forceps_tip" not in found or "forceps_line" in found
        assert ("left_jaw" in found) == ("right_jaw" in found) == ("forceps_jaws" in found)
        if "left_jaw" in found:
            assert isinstance(found["forceps_jaws"], Polyline)
            assert truth.inside


def test_position_and_width_of_blood_are_accurate(detections):
    for _, truth, found in detections:
        blood = found["hemorrhage"]
        assert isinstance(blood, Circle)
        assert math.dist(blood.center_mm, truth.others["hemorrhage"].center_mm) < 0.25
        assert blood.radius_mm == pytest.approx(truth.others["hemorrhage"].radius_mm, abs=0.25)


def test_grey_images_show_forceps_but_no_tissue():
    reader = RunReader(RUN)
    perceive = ForcepsPerceiver(parse_registration(reader.info.registration, "run"), PerceptionConfig())
    found = {}
    for capture, _ in reader.records():
        if capture.image is not None and capture.truth.depth_mm < 15:
            grey = np.ascontiguousarray(capture.image[..., 1])
            found = perceive(replace(capture, image=grey)).found
        elif capture.truth is None or capture.truth.depth_mm > 15:
            break
    assert isinstance(found["forceps_tip"], Point)
    assert not {"membrane_edge", "hemorrhage"} & set(found)


def test_a_background_image_has_neither_forceps_nor_tissue(registration):
    perceive = ForcepsPerceiver(registration, PerceptionConfig())
    image = np.full((240, 320, 3), 180, np.uint8)
    for number in range(3):
        assert perceive(Capture(number, number, image)).found == registration.anatomy


def test_a_light_pipe_that_enters_late_is_found_within_a_tenth_of_a_second():
    scenario = load_scenario("membrane_peeling")
    away, inside = (replace(scenario.moves[0], duration_s=0.7, pipe_depth_mm=mm) for mm in (-20.0, 8.0))
    phantom = Phantom(replace(scenario, moves=(away, inside)))
    perceive = ForcepsPerceiver(parse_registration(phantom.registration, "eye"), PerceptionConfig())
    is_due, is_found = [], []
    while (moment := phantom.advance()) is not None:
        observation = perceive(capture_of(moment, len(is_due), len(is_due) * 33_000_000))
        is_due.append(math.hypot(*moment.truth.others["light_pipe_tip"].at_mm) < 12.0)
        is_found.append("light_pipe_tip" in observation.found)
    assert not any(is_found[:10])
    assert is_found.index(True) <= is_due.index(True) + 2
    assert all(is_found[is_due.index(True) + 2 :])
