import threading

import pytest
from msgspec.structs import replace

from haptigraph.clock import VirtualClock
from haptigraph.errors import BadInput
from haptigraph.messages import Fault
from haptigraph.robot.interface import Operating, RobotReading
from haptigraph.robot.listening import Listener, sample_of
from haptigraph.robot.pose import ToolPose
from haptigraph.robot.setup import parse_setup

SETUP = parse_setup(
    """
[rcm]
at_mm = [0.0, 0.0, 0.0]
[eye]
translation_mm = [1.0, 2.0, 3.0]
quaternion = [0.0, 0.0, 0.0, 1.0]
tip_sd_mm = 0.2
""",
    "robot.toml",
)
READING = RobotReading(
    1_000_000_000, 1_020_000_000, ToolPose((5.0, 2.0, 3.0)), Operating("ENABLED", True, False), number=1
)


class FakeRobot:
    """Reports one reading after the other, each twice, and must not be commanded."""

    def __init__(self, count):
        self.count, self.calls, self.closed, self.done = count, 0, False, threading.Event()

    def read(self):
        self.calls += 1
        number = min(self.calls // 2, self.count)
        if self.calls > 2 * self.count + 2:
            self.done.set()
        problems = ("a pose in another frame",) if number else ()
        return replace(READING, number=number, stamp_ns=number, problems=problems)

    def close(self):
        self.closed = True

    def __getattr__(self, name):
        raise AssertionError(f"a run must not call {name}")


def test_a_sample_says_where_the_tip_is_in_the_eye_and_when_it_was_there():
    sample = sample_of(READING, SETUP, latency_ms=20.0)
    assert sample.eye_tip_mm == (4.0, 0.0, 0.0) and sample.eye_tip_sd_mm == 0.2
    assert sample.stamp_ns == 980_000_000 and sample.operating == "ENABLED"


def test_without_calibration_there_is_no_tip_and_without_a_valid_pose_no_sample():
    assert sample_of(READING, None).eye_tip_mm is None
    assert sample_of(replace(READING, pose=None), SETUP) is None
    assert sample_of(replace(READING, pose=ToolPose((float("nan"), 0.0, 0.0))), SETUP) is None


def test_every_reading_is_taken_once_and_nothing_is_commanded():
    robot = FakeRobot(5)
    listener = Listener(lambda clock: robot, VirtualClock(), SETUP)
    robot.done.wait(10)
    assert [sample.stamp_ns for sample in listener.take()] == [1, 2, 3, 4, 5]
    assert listener.take() == ()
    assert listener.take_faults() == (Fault("robot", "a pose in another frame"),)
    assert listener.take_faults() == ()
    listener.close()
    listener.close()
    assert robot.closed


def test_a_robot_that_cannot_be_opened_is_an_error_of_the_run():
    def fails(clock):
        raise BadInput("no such robot")

    with pytest.raises(BadInput, match="no such robot"):
        Listener(fails, VirtualClock(), None)
