import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.robot.pose import (
    ToolPose,
    Transform,
    angle_deg,
    composed,
    quaternion_of,
    rotated,
    rotation_of,
)

NUMBER = st.floats(-1, 1)
QUATERNIONS = st.tuples(NUMBER, NUMBER, NUMBER, NUMBER).filter(lambda q: math.hypot(*q) > 0.1)
POINTS = st.tuples(*3 * [st.floats(-500, 500)])
POSES = st.builds(lambda at, q: ToolPose(at, tuple(each / math.hypot(*q) for each in q)), POINTS, QUATERNIONS)


@given(QUATERNIONS)
def test_a_rotation_is_orthonormal_and_gives_its_quaternion_back(quaternion):
    rotation = rotation_of(quaternion)
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    back = quaternion_of(rotation)
    assert back[3] >= 0 and math.hypot(*back) == pytest.approx(1.0)
    assert rotation_of(back) == pytest.approx(rotation, abs=1e-12)


@given(QUATERNIONS, QUATERNIONS, POINTS)
def test_quaternions_rotate_and_compose_as_their_matrices_do(one, other, point):
    matrix = rotation_of(one) @ rotation_of(other)
    assert rotated(one, point) == pytest.approx(rotation_of(one) @ point, abs=1e-9)
    assert rotation_of(composed(one, other)) == pytest.approx(matrix, abs=1e-12)
    assert math.hypot(*composed(one, other)) == pytest.approx(1.0)


@given(POSES, POSES, POINTS)
def test_transforms_compose_and_invert(one, other, point):
    first, second = Transform.of(one), Transform.of(other)
    assert (second @ first).point_mm(point) == pytest.approx(second.point_mm(first.point_mm(point)), abs=1e-9)
    assert first.inverse().point_mm(first.point_mm(point)) == pytest.approx(np.array(point), abs=1e-9)
    there = second.inverse().pose(second.pose(one))
    assert there.position_mm == pytest.approx(one.position_mm, abs=1e-9)
    assert angle_deg(there, one) == pytest.approx(0, abs=1e-6)


def test_a_quarter_turn_about_z_takes_x_to_y():
    pose = ToolPose((1.0, 2.0, 3.0), (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)))
    assert pose.axis((1.0, 0.0, 0.0)) == pytest.approx(np.array((0.0, 1.0, 0.0)))
    assert Transform.of(pose).point_mm((1.0, 0.0, 0.0)) == pytest.approx(np.array((1.0, 3.0, 3.0)))
    assert angle_deg(pose, ToolPose((0.0, 0.0, 0.0))) == pytest.approx(90)


@pytest.mark.parametrize(
    "pose",
    [
        ToolPose((math.nan, 0, 0)),
        ToolPose((0, math.inf, 0)),
        ToolPose((0, 0, 0), (0, 0, 0, 0)),
        ToolPose((0, 0, 0), (0, 0, 0, 2)),
    ],
)
def test_a_pose_that_is_no_pose_says_so(pose):
    assert not pose.is_finite
