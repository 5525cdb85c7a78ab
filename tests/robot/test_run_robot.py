import pytest

from haptigraph.clock import MonotonicClock, VirtualClock
from haptigraph.config import RobotConfig
from haptigraph.errors import BadInput
from haptigraph.robot.interface import RobotReading
from haptigraph.robot.pose import ToolPose
from haptigraph.run_robot import open_readings
from haptigraph.stages import Source

SETUP = """
[rcm]
at_mm = [0.0, 0.0, 0.0]
[eye]
translation_mm = [1.0, 0.0, 0.0]
quaternion = [0.0, 0.0, 0.0, 1.0]
tip_sd_mm = 0.2
"""


class NoSource(Source):
    rate_hz, is_live = 30.0, True


class Steered:
    def take_readings(self):
        return [RobotReading(7, 8, ToolPose((3.0, 0.0, 0.0)), number=1), RobotReading(9, 9)]


@pytest.fixture
def setup(tmp_path):
    path = tmp_path / "robot.toml"
    path.write_text(SETUP)
    return path


def test_without_a_robot_there_are_no_readings_but_those_of_the_source():
    source = NoSource()
    source.robot_setup = SETUP
    readings, text = open_readings(RobotConfig(), source, VirtualClock())
    assert readings.take() == () and text == SETUP
    readings.close()


def test_a_robot_that_a_page_steers_is_not_opened_again(setup):
    config = RobotConfig("crtk:PSM1", str(setup))
    readings, text = open_readings(config, NoSource(), MonotonicClock(), Steered())
    (sample,) = readings.take()
    assert sample.eye_tip_mm == (2.0, 0.0, 0.0) and sample.stamp_ns == 7 and text == SETUP
    readings.close()


@pytest.mark.parametrize(
    "config, clock, own, problem",
    [
        (RobotConfig(setup="robot.toml"), MonotonicClock(), None, "goes with robot.uri"),
        (RobotConfig("crtk:PSM1"), VirtualClock(), None, "works in real time"),
        (RobotConfig("crtk:PSM1"), MonotonicClock(), SETUP, "readings of its own"),
        (RobotConfig("none:PSM1"), MonotonicClock(), None, "unknown robot"),
    ],
)
def test_what_cannot_be_read_is_refused(config, clock, own, problem):
    source = NoSource()
    source.robot_setup = own
    with pytest.raises(BadInput, match=problem):
        open_readings(config, source, clock)
