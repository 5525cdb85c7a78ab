import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("cyclonedds")

from haptigraph.robot.pose import ToolPose
from haptigraph.robot.ros.poses import as_message, finite_vector, tool_pose
from haptigraph.ros2.geometry_types import Quaternion, Vector3
from haptigraph.ros2.types import Point

LENGTHS = st.floats(-9000, 9000)


@given(st.tuples(LENGTHS, LENGTHS, LENGTHS), st.tuples(*[st.floats(-1, 1)] * 4))
def test_a_pose_survives_the_way_there_and_back(position_mm, raw):
    length = math.hypot(*raw)
    quaternion = tuple(value / length for value in raw) if length > 1e-3 else (0.0, 0.0, 0.0, 1.0)
    message = as_message(ToolPose(position_mm, quaternion))
    assert message.position.x == pytest.approx(position_mm[0] / 1e3)
    back = tool_pose(message.position, message.orientation)
    assert back.position_mm == pytest.approx(position_mm)
    assert back.quaternion == quaternion


@pytest.mark.parametrize(
    ("position_m", "quaternion", "said"),
    [
        ((math.nan, 0, 0), (0, 0, 0, 1), "a pose that is not finite"),
        ((0, 0, 0), (0, math.inf, 0, 1), "a pose that is not finite"),
        ((0, 0, 0), (0, 0, 0, 0), "a quaternion of length 0, not 1"),
        ((0, 0, 0), (0, 0, 0, 1.01), "a quaternion of length 1.01, not 1"),
        ((120.0, 0, 0), (0, 0, 0, 1), "a tool 120 m from the base; positions must be in metres"),
    ],
)
def test_what_is_no_pose_is_refused(position_m, quaternion, said):
    with pytest.raises(ValueError, match=said):
        tool_pose(Point(*map(float, position_m)), Quaternion(*map(float, quaternion)))


def test_a_vector_must_be_finite():
    assert finite_vector(Vector3(1.0, 2.0, 3.0), "a force") == (1.0, 2.0, 3.0)
    with pytest.raises(ValueError, match="a force that is not finite"):
        finite_vector(Vector3(1.0, math.nan, 3.0), "a force")
