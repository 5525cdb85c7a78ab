"""The summary of the needle out of the section."""

import pytest

from haptigraph.analysis.metrics.in_space import InSpace, in_space_text, out_of_section
from haptigraph.geometry import Point, Segment
from haptigraph.messages import Certainty, Observation


def observation(z_mm):
    found = {"needle_tip": Point((3.0, 0.0)), "needle_3d": Segment((0.0, 0.0), (3.0, 4.0), 0.0, z_mm)}
    return Observation(0, found, certainty=Certainty(1.0, 0.1, 0.1, 0.5), sd_mm={"needle_3d": 0.2})


def test_the_angle_and_the_side_are_those_of_the_shaft():
    assert out_of_section(observation(-5.0)) == pytest.approx((-5.0, -45.0, 0.2, 0.5))
    assert in_space_text(observation(-5.0)) == "tip 5.0 ± 0.2 mm away from the camera, shaft 45.0 ± 0.5°"
    assert "towards the camera" in in_space_text(observation(1.0))


@pytest.mark.parametrize(
    "lacking", [{"certainty": None}, {"certainty": Certainty(1.0, 0.1, 0.1)}, {"sd_mm": {}}]
)
def test_nothing_is_said_without_an_uncertainty(lacking):
    given = {"certainty": Certainty(1.0, 0.1, 0.1, 0.5), "sd_mm": {"needle_3d": 0.2}}
    partial = Observation(0, observation(1.0).found, **{**given, **lacking})
    assert in_space_text(partial) == ""


def test_the_greatest_distance_and_how_often_it_was_known_are_summed_up():
    summed = InSpace()
    assert summed.lines == []
    for each in (
        observation(1.0),
        observation(-2.0),
        observation(1.5),
        Observation(0, {"needle_tip": Point((0.0, 0.0))}),
    ):
        summed.add(each)
    (line,) = summed.lines
    assert "2.0 ± 0.2 mm away from the camera" in line
    assert "known in 3 of 4 steps with a tip" in line
