"""States of MoveIt Servo, and its faults."""

import time
import uuid
from contextlib import suppress
from itertools import groupby

import pytest
from ros_network import robot_peer, until

pytest.importorskip("cyclonedds")

from haptigraph.clock import MonotonicClock
from haptigraph.errors import DeviceError
from haptigraph.robot.ros.servo import STATES, ServoRobot, servo_frames
from haptigraph.ros2 import services

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


def test_a_status_is_an_operating_state(connected):
    robot, process = connected
    for code, state in STATES.items():
        process.stdin.write(f"{code}\n")
        until(lambda state=state: robot.read().operating.state == state, f"the state does not follow {code}")


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


@pytest.mark.parametrize("mode", ["with a header", "plain"])
def test_servo_is_set_to_poses_paused_and_resumed_by_its_services(ros_network, mode, monkeypatch):
    """With the messages of Cyclone DDS, and those of Fast DDS, which have no header."""
    name = f"servo_{uuid.uuid4().hex}"
    if mode == "plain":
        monkeypatch.setattr(services, "CYCLONE", b"")
    with robot_peer("servo", f"/{name}", mode) as process:
        robot = ServoRobot(name, MonotonicClock())
        until(lambda: robot.read().operating is not None, "no reading")
        for command in ("enable", "home", "pause"):
            robot.request(command)
        until(lambda: robot.read().operating.state == "DISABLED", "it is not paused")
        robot.request("resume")
        until(lambda: robot.read().operating.state == "ENABLED", "it does not go on")
        robot.close()
        assert robot.read().problems == ()
        process.terminate()
        called = process.stdout.read().split("\n")
    assert called[0] == "switch_command_type 2"
    pauses = [line.split()[1] for line in called if line.startswith("pause")]
    assert [value for value, _ in groupby(pauses)] == ["False", "True", "False"]


def test_a_service_that_refuses_is_a_problem(connected):
    robot, process = connected
    process.stdin.write("refuse\n")
    robot.request("pause")
    until(lambda: any("pause_servo refused True" in one for one in robot.read().problems), "not reported")


def test_services_that_nobody_offers_are_a_problem(ros_network, monkeypatch):
    monkeypatch.setattr("haptigraph.robot.ros.servo.DISCOVERY_S", 0.0)
    robot = ServoRobot("nobody", MonotonicClock())
    robot.request("disable")
    until(
        lambda: any("no node offers the service /nobody/pause_servo" in one for one in robot.read().problems),
        "not reported",
    )
    with suppress(DeviceError):
        robot.close()


def test_frames_are_those_of_ros_by_default():
    assert servo_frames("servo_node") == ("/servo_node", "base_link", "tool0")
    assert servo_frames("/a/servo/?tool=/tip") == ("/a/servo", "base_link", "tip")
