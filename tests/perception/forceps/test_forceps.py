"""Forceps, light pipe, membrane and blood, looked for in the images of the golden run; the truth lies beside."""

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

RUN = GOLDEN / "membrane_peeling.mcap"
COLLISION_S = (21.0, 24.0)


@pytest.fixture(scope="module")
def seen():
    """Every capture with an image, and what was made of it."""
    reader = RunReader(RUN)
    perceive = ForcepsPerceiver(parse_registration(reader.info.registration, "run"), PerceptionConfig())
    captures = [capture for capture, _ in reader.records() if capture.image is not None]
    first_ns = captures[0].stamp_ns
    blind = [replace(capture, truth=None) for capture in captures]
    looked = [perceive(capture) for capture in blind]
    perceive.reset()
    assert [perceive(capture) for capture in blind] == looked
    return [((c.stamp_ns - first_ns) / 1e9, c.truth, o.found) for c, o in zip(captures, looked, strict=True)]


def errors_mm(seen, name: str, least_depth_mm: float = 4.0) -> list[float]:
    return [
        math.dist(found[name].at_mm, truth.others[name].at_mm) if name in found else math.inf
        for time_s, truth, found in seen
        if truth.depth_mm > least_depth_mm and not COLLISION_S[0] < time_s < COLLISION_S[1]
    ]


@pytest.mark.parametrize("name", ["forceps_tip", "left_jaw", "right_jaw", "membrane_edge", "light_pipe_tip"])
def test_tips_and_edge_are_found_within_three_pixels(seen, name):
    errors = errors_mm(seen, name)
    assert len(errors) > 70
    assert np.percentile(errors, 90) < 3 / 8.8
    assert np.median(errors) < 1 / 8.8


def test_jaws_are_seen_to_open_and_close(seen):
    counted = agreed = 0
    for _, truth, found in seen:
        if "left_jaw" not in found or truth.depth_mm < 4:
            continue
        opening = [math.dist(at["left_jaw"].at_mm, at["right_jaw"].at_mm) for at in (truth.others, found)]
        if not 0.5 < opening[0] < 0.9:  # on the way
            counted += 1
            agreed += (opening[0] > 0.7) == (opening[1] > 0.7)
    assert counted > 80
    assert agreed >= counted - 2


def test_forceps_bring_tip_line_and_both_jaws_or_nothing(seen):
    for _, truth, found in seen:
        assert ("forceps_tip" in found) == ("forceps_line" in found)
        assert ("left_jaw" in found) == ("right_jaw" in found) == ("forceps_jaws" in found)
        if "left_jaw" in found:
            assert isinstance(found["forceps_jaws"], Polyline)
            assert truth.inside


def test_blood_lies_where_it_is_and_is_about_as_wide(seen):
    for _, truth, found in seen:
        blood = found["hemorrhage"]
        assert isinstance(blood, Circle)
        assert math.dist(blood.center_mm, truth.others["hemorrhage"].center_mm) < 0.25
        assert blood.radius_mm == pytest.approx(truth.others["hemorrhage"].radius_mm, abs=0.25)


def test_without_colour_tissue_is_not_guessed_but_forceps_are_found():
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


def test_an_empty_eye_has_neither_forceps_nor_tissue(registration):
    perceive = ForcepsPerceiver(registration, PerceptionConfig())
    image = np.full((240, 320, 3), 180, np.uint8)
    for number in range(3):
        assert perceive(Capture(number, number, image)).found == registration.anatomy
