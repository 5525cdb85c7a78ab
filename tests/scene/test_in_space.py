"""Measures of a shaft in space."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from haptigraph.geometry import Circle, Point, Segment
from haptigraph.messages import Certainty
from haptigraph.scene.relations import MEASURES

GLOBE, TARGET = Circle((0.0, 0.0), 12.0), Point((0.0, -12.0))
FOUND = {"trocar": Point((0.0, 12.0)), "eye_globe": GLOBE, "retina_target": TARGET}
COORDINATE = st.floats(-10, 10)


def measure(name, subject, object_):
    return MEASURES[name].function(subject, object_, FOUND)


def shaft(x_mm, y_mm, z_mm):
    return Segment((0.0, 12.0), (x_mm, 12.0 + y_mm), 0.0, z_mm)


@given(COORDINATE, COORDINATE, COORDINATE)
def test_the_angle_in_space_is_that_of_the_vectors(x_mm, y_mm, z_mm):
    length = math.hypot(x_mm, y_mm, z_mm)
    assume(length > 0.1)
    found = measure("theta_space_deg", shaft(x_mm, y_mm, z_mm), TARGET)
    assert math.cos(math.radians(found)) == pytest.approx(-y_mm / length, abs=1e-9)


@given(COORDINATE, st.floats(-20, -0.1))
def test_in_the_section_both_angles_are_one(x_mm, y_mm):
    line = shaft(x_mm, y_mm, 0.0)
    expected = MEASURES["theta_deg"].function(line, TARGET, FOUND)
    assert measure("theta_space_deg", line, TARGET) == pytest.approx(expected)
    assert measure("out_of_plane_mm", line, GLOBE) == measure("out_of_plane_deg", line, GLOBE) == 0


@pytest.mark.parametrize("z_mm", [-3.0, 3.0])
def test_out_of_plane_is_the_same_on_either_side(z_mm):
    assert measure("out_of_plane_mm", shaft(0.0, -4.0, z_mm), GLOBE) == 3.0
    assert measure("out_of_plane_deg", shaft(0.0, -4.0, z_mm), GLOBE) == pytest.approx(36.8699, abs=1e-4)


def test_other_shapes_and_a_missing_trocar_have_no_measure():
    for name, object_ in (
        ("out_of_plane_mm", GLOBE),
        ("out_of_plane_deg", GLOBE),
        ("theta_space_deg", TARGET),
    ):
        assert measure(name, TARGET, object_) is None
    assert MEASURES["theta_space_deg"].function(shaft(0.0, -4.0, 1.0), TARGET, {}) is None


def test_an_angle_in_space_is_as_uncertain_as_the_worse_of_both():
    sd = MEASURES["theta_space_deg"].sd
    assert sd(Certainty(1.0, 0.1, 0.2)) is None
    assert sd(Certainty(1.0, 0.1, 0.2, 0.9)) == 0.9
    assert sd(Certainty(1.0, 0.1, 0.2, 0.1)) == 0.2
