import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.robot.pose import ToolPose, angle_deg, rotation_of
from haptigraph.robot.rcm import Rcm, direction_of, minimal_rotation, turned

AT_MM = (157.5, -20.0, 70.4)
RCM = Rcm(AT_MM, (0.0, 0.0, 1.0))
NUMBER = st.floats(-1, 1)
DIRECTIONS = st.tuples(NUMBER, NUMBER, NUMBER).filter(lambda v: math.hypot(*v) > 0.1).map(np.array)
QUATERNIONS = st.tuples(NUMBER, NUMBER, NUMBER, NUMBER).filter(lambda q: math.hypot(*q) > 0.1)
DEPTHS_MM = st.floats(-30, 30)


def pose_of(quaternion, position_mm=AT_MM) -> ToolPose:
    return ToolPose(position_mm, tuple(each / math.hypot(*quaternion) for each in quaternion))


@given(DEPTHS_MM, DIRECTIONS, QUATERNIONS)
def test_the_shaft_of_a_pose_passes_through_the_rcm_at_any_depth(depth_mm, direction, quaternion):
    pose = RCM.pose(depth_mm, direction, pose_of(quaternion))
    assert RCM.distance_mm(pose) < 1e-9
    assert RCM.depth_mm(pose) == pytest.approx(depth_mm, abs=1e-9)
    assert RCM.direction(pose) == pytest.approx(direction / np.linalg.norm(direction), abs=1e-9)


@given(DIRECTIONS, QUATERNIONS)
def test_a_pose_is_reached_by_the_smallest_rotation(direction, quaternion):
    before = pose_of(quaternion)
    after = RCM.pose(10.0, direction, before)
    along = RCM.direction(before)
    between = math.degrees(
        math.atan2(np.linalg.norm(np.cross(along, direction)), float(along @ direction))
    )  # no rotation between the two shafts is smaller
    assert angle_deg(before, after) == pytest.approx(between, abs=1e-5)


@given(st.floats(-20, 20), st.floats(0, 2), QUATERNIONS, st.floats(0, 2 * math.pi))
def test_the_distance_of_a_shaft_is_defined_also_at_and_beyond_the_rcm(depth_mm, aside_mm, quaternion, angle):
    rotation = rotation_of(quaternion)
    aside = rotation @ np.array((math.cos(angle), math.sin(angle), 0.0))
    tip_mm = np.array(AT_MM) + depth_mm * rotation[:, 2] + aside_mm * aside
    pose = pose_of(quaternion, tuple(tip_mm.tolist()))
    assert RCM.distance_mm(pose) == pytest.approx(aside_mm, abs=1e-9)
    assert RCM.offset_mm(pose) == pytest.approx(aside_mm * aside, abs=1e-9)


@given(st.lists(st.tuples(st.floats(-40, 40), st.floats(-40, 40)), min_size=1, max_size=10))
def test_there_and_back_leaves_no_rotation_about_the_shaft(angles):
    start = RCM.pose(10.0, direction_of(0.0, 0.0), pose_of((0.3, 0.4, -0.1, 0.6)))
    path = [start]
    for pitch_deg, elevation_deg in angles:
        path.append(RCM.pose(10.0, direction_of(pitch_deg, elevation_deg), path[-1]))
    back = path[-1]
    for pose in reversed(path[:-1]):
        back = RCM.pose(10.0, RCM.direction(pose), back)
    assert angle_deg(start, back) < 1e-6


@pytest.mark.parametrize("tilt_deg", [5.0, 20.0, 45.0])
def test_around_a_loop_the_roll_changes_by_the_solid_angle_and_no_more(tilt_deg):
    """Parallel transport: the only roll is what the sphere's curvature demands (Gauss and Bonnet)."""
    home = np.array((0.0, 0.0, -1.0))
    steps = 720
    start = pose = RCM.pose(10.0, _cone(home, tilt_deg, 0.0), pose_of((0.1, 0.2, 0.3, 0.9)))
    for step in range(1, steps + 1):
        pose = RCM.pose(10.0, _cone(home, tilt_deg, 2 * math.pi * step / steps), pose)
    solid_angle_deg = 360 * (1 - math.cos(math.radians(tilt_deg)))
    expected_deg = min(solid_angle_deg, 360 - solid_angle_deg)
    assert angle_deg(start, pose) == pytest.approx(expected_deg, abs=0.02)


def _cone(home, tilt_deg, azimuth):
    aside = np.array((math.cos(azimuth), math.sin(azimuth), 0.0))
    return turned(home, aside, math.radians(tilt_deg))


def test_opposite_directions_are_turned_into_each_other():
    for axis in np.eye(3):
        rotation = rotation_of(minimal_rotation(axis, -axis))
        assert rotation @ axis == pytest.approx(-axis)
        assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_two_angles_give_a_direction_in_the_eye_frame():
    assert direction_of(0, 0) == pytest.approx(np.array((0, -1, 0)))
    assert direction_of(90, 0) == pytest.approx(np.array((1, 0, 0)))
    assert direction_of(0, 90) == pytest.approx(np.array((0, 0, 1)))
