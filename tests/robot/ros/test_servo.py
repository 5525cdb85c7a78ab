"""States of MoveIt Servo, and its faults."""

import time
import uuid

import pytest
from ros_network import robot_peer, until

pytest.importorskip("cyclonedds")

from haptigraph.clock import MonotonicClock
from haptigraph.robot.ros.servo import STATES, ServoRobot, servo_frames

pytestmark = pytest.mark.realtime


@pytest.fixture
def connected(ros_network):
    name = f"servo_{uuid.uuid4().hex}"
    with robot_peer("servo", f"/{name}") as process:
        robot = ServoRobot(f"{name}?base=base_link&tool=tool0", MonotonicClock())
        until(lambda: robot.read().number > 5 and robot.read().operating is not None, "no reading")
        yield robot, process
        robot.close()


def test_the_tool_is_found_through_static_and_moving_transforms(connected):
    robot, _ = connected
    assert robot.read().pose.position_mm == pytest.approx((170.0, -30.0, 100.0))


@pytest.mark.parametrize("code", STATES)
def test_a_status_is_an_operating_state(connected, code):
    robot, process = connected
    process.stdin.write(f"{code}\n")
    until(lambda: robot.read().operating.state == STATES[code], "the state does not follow")


def test_an_unknown_status_is_a_fault(connected):
    robot, process = connected
    process.stdin.write("42\n")
    until(lambda: robot.read().operating.state == "FAULT", "the state does not follow")
    assert any("unknown status 42" in problem for problem in robot.read().problems)


def test_servo_that_is_paused_is_disabled_and_a_silent_tf_grows_old(connected):
    robot, process = connected
    process.stdin.write("pause\n")
    until(lambda: robot.read().operating.state == "DISABLED", "the state does not follow")
    process.stdin.write("quiet\n")
    until(lambda: time.monotonic_ns() - robot.read().stamp_ns > 2e8, "poses do not grow old")


def test_its_state_is_up_to_the_user(connected):
    robot, _ = connected
    robot.request("enable")
    assert any("enable is up to the user" in problem for problem in robot.read().problems)


def test_frames_are_those_of_ros_by_default():
    assert servo_frames("servo_node") == ("/servo_node", "base_link", "tool0")
    assert servo_frames("/a/servo/?tool=/tip") == ("/a/servo", "base_link", "tip")
