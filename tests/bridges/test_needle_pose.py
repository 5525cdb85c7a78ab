import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.bridges.needle_pose import (
    UNKNOWN_SD_M,
    UNKNOWN_SD_RAD,
    found_needle,
    needle_matrix,
    pose_covariance,
)
from haptigraph.geometry import Point, Segment
from haptigraph.messages import Certainty, Observation
from haptigraph.robot.pose import quaternion_of

LINE = Segment((2.0, 10.0), (1.0, -4.0))
CERTAINTY = Certainty(0.9, 0.08, 0.4)
points = st.tuples(st.floats(-20, 20), st.floats(-20, 20))
depths = st.just(0.0) | st.floats(-20, 20)


def pose_of(start, end, start_z=0.0, end_z=0.0):
    return needle_matrix(Segment(start, end, start_z, end_z), Point(end, end_z))


@given(points, points, depths, depths)
def test_the_needle_is_a_rotation_with_its_origin_at_the_tip(start, end, start_z, end_z):
    matrix = np.array(pose_of(start, end, start_z, end_z))
    rotation = matrix[:, :3]
    assert np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    assert tuple(matrix[:, 3]) == (*end, end_z)
    assert rotation[2, 0] == 0.0  # x lies in the section
    assert rotation[2, 1] <= 0.0  # y points away from the viewer
    length_mm = math.dist((*start, start_z), (*end, end_z))
    if length_mm > 1e-6:  # a model along -z, as SlicerIGT makes them, coincides with the shaft
        assert np.allclose(matrix @ [0, 0, -length_mm, 1], (*start, start_z), atol=1e-6)


def test_a_bevelled_needle_is_at_its_tip_with_the_rotation_of_its_shaft():
    symmetric, bevelled = (
        np.array(needle_matrix(LINE, tip)) for tip in (Point((1.0, -4.0)), Point((1.3, -4.0)))
    )
    assert (symmetric[:, :3] == bevelled[:, :3]).all()
    assert tuple(symmetric[:, 3]) == (1.0, -4.0, 0.0)
    assert tuple(bevelled[:, 3]) == (1.3, -4.0, 0.0)


@given(points, points, depths, depths)
def test_a_quaternion_is_the_rotation_of_its_matrix(start, end, start_z, end_z):
    matrix = pose_of(start, end, start_z, end_z)
    x, y, z, w = quaternion_of(np.array(matrix)[:, :3])
    assert math.hypot(x, y, z, w) == pytest.approx(1.0)
    assert w >= 0
    rotated = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    assert np.allclose(rotated, np.array(matrix)[:, :3], atol=1e-9)


@given(points, points)
def test_of_a_section_nothing_is_known_out_of_it(start, end):
    covariance = pose_covariance(pose_of(start, end), CERTAINTY, is_volume=False)
    sd = np.sqrt(np.diag(covariance))
    angle = math.radians(CERTAINTY.theta_sd_deg)
    assert sd == pytest.approx([8e-5, 8e-5, UNKNOWN_SD_M, UNKNOWN_SD_RAD, UNKNOWN_SD_RAD, angle])
    assert np.count_nonzero(covariance) == 6


@given(points, points, depths, depths)
def test_of_a_volume_only_the_roll_about_the_shaft_is_unknown(start, end, start_z, end_z):
    matrix = pose_of(start, end, start_z, end_z)
    covariance = pose_covariance(matrix, CERTAINTY, is_volume=True)
    assert np.allclose(covariance, covariance.T)
    assert np.sqrt(np.diag(covariance)[:3]) == pytest.approx([8e-5] * 3)
    shaft, across = np.array(matrix)[:, 2], np.array(matrix)[:, 0]
    rotation = covariance[3:, 3:]
    assert shaft @ rotation @ shaft == pytest.approx(UNKNOWN_SD_RAD**2)
    assert across @ rotation @ across == pytest.approx(math.radians(CERTAINTY.theta_sd_deg) ** 2, abs=1e-9)


@pytest.mark.parametrize("certainty", [None, Certainty(0.9, None, 0.4)])
def test_a_tip_without_standard_deviation_has_an_unknown_position(certainty):
    covariance = pose_covariance(needle_matrix(LINE, Point(LINE.end_mm)), certainty, is_volume=False)
    assert np.sqrt(np.diag(covariance)[:3]) == pytest.approx([UNKNOWN_SD_M] * 3)
    known = certainty is not None
    assert (covariance[5, 5] == UNKNOWN_SD_RAD**2) is not known


def test_a_pose_needs_shaft_and_tip():
    tip = Point((1.0, -4.0))
    assert found_needle(Observation(0, {"needle_line": LINE, "needle_tip": tip})) == (LINE, tip)
    assert found_needle(Observation(0, {"needle_line": LINE})) is None
    assert found_needle(Observation(0, {"needle_tip": tip})) is None
