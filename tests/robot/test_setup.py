import pytest

from haptigraph.errors import BadInput
from haptigraph.robot.setup import parse_setup

GOOD = """
shaft_axis = "-x"
[rcm]
at_mm = [10.0, -20.0, 30.0]
[eye]
translation_mm = [1.0, 2.0, 3.0]
quaternion = [0.0, 0.0, 1.0, 0.0]
[limits]
speed_mm_s = 5.0
"""


def test_a_setup_says_where_robot_and_eye_are():
    setup = parse_setup(GOOD, "robot.toml")
    assert setup.shaft_axis_tool == (-1.0, 0.0, 0.0)
    assert setup.eye.robot_from_eye.point_mm((1.0, 0.0, 0.0)).tolist() == pytest.approx([0.0, 2.0, 3.0])
    assert setup.limits.speed_mm_s == 5.0 and setup.rcm.sd_mm is None


@pytest.mark.parametrize(
    "wrong, right, problem",
    [
        ("speed_mm_s = 5.0", "speed_mm_s = -1", "speed_mm_s"),
        ("quaternion = [0.0, 0.0, 1.0, 0.0]", "quaternion = [0.0, 0.0, 2.0, 0.0]", "length 1"),
        ("at_mm = [10.0, -20.0, 30.0]", "", "at_mm"),
        ("at_mm = [10.0, -20.0, 30.0]", "at_mm = [10.0, nan, 30.0]", "at_mm"),
        ('shaft_axis = "-x"', 'shaft_axis = "x"', "shaft_axis"),
        ("[rcm]", "speed = 1\n[rcm]", "speed"),
    ],
)
def test_what_is_wrong_is_named(wrong, right, problem):
    with pytest.raises(BadInput, match=problem) as error:
        parse_setup(GOOD.replace(wrong, right), "robot.toml")
    assert "robot.toml" in str(error.value)
