"""Every robot fulfils the Robot contract. A robot on a network is a simulated one in another process."""

import time
import uuid
from contextlib import contextmanager, nullcontext

import pytest
from msgspec.structs import replace
from ros_network import robot_peer, until

from haptigraph.clock import MonotonicClock
from haptigraph.errors import BadInput
from haptigraph.robot.interface import Robot
from haptigraph.robot.opening import ROBOTS, open_robot

pytestmark = pytest.mark.realtime

# How each robot is opened, and what is at its other end.
OPENERS = {
    "crtk": lambda name: (f"crtk:{name}", robot_peer("crtk", f"/{name}")),
    "servo": lambda name: (f"servo:{name}", robot_peer("servo", f"/{name}")),
    "simulated": lambda name: ("simulated", nullcontext(None)),
}
STEP_MM = 0.3


@contextmanager
def connected(kind):
    uri, peer = OPENERS[kind](f"arm_{uuid.uuid4().hex}")
    with peer as process:
        robot = open_robot(uri, MonotonicClock())
        try:
            yield robot, process
        finally:
            robot.close()


@pytest.fixture(params=ROBOTS)
def robot(request):
    if request.param != "simulated":
        pytest.importorskip("cyclonedds")
        request.getfixturevalue("ros_network")
    with connected(request.param) as (opened, _):
        until(lambda: opened.read().pose is not None and opened.read().operating is not None, "no reading")
        yield opened


def enable(robot):
    if robot.read().operating.state != "ENABLED":
        robot.request("enable")
    until(lambda: robot.read().operating.state == "ENABLED", "never enabled")
    if not robot.read().operating.is_homed:
        robot.request("home")
    until(lambda: robot.read().operating.is_homed, "never homed")


def moved(robot):
    """Command the robot a little aside, as a loop does, until it is there."""
    clock, pose = MonotonicClock(), robot.read().pose
    x_mm, *rest = pose.position_mm
    target = replace(pose, position_mm=(x_mm + STEP_MM, *rest))

    def is_there():
        robot.move(target, clock.now_ns())
        return abs(robot.read().pose.position_mm[0] - target.position_mm[0]) < 0.15

    until(is_there, "the robot does not follow")
    return target


def test_all_robots_are_under_contract():
    assert set(OPENERS) == set(ROBOTS)


def test_a_robot_reports_valid_readings_that_advance(robot):
    assert isinstance(robot, Robot)
    first = robot.read()
    until(lambda: robot.read().number > first.number + 5, "no more readings")
    later = robot.read()
    assert first.stamp_ns < later.stamp_ns <= later.received_ns <= time.monotonic_ns()
    assert later.pose.is_finite
    assert later.problems == ()


def test_a_robot_goes_where_it_is_commanded_and_stays_there_when_held(robot):
    enable(robot)
    target = moved(robot)
    for _ in range(3):
        robot.hold(time.monotonic_ns())
    before = robot.read().number
    until(lambda: robot.read().number > before + 20, "no more readings")
    assert robot.read().pose.position_mm == pytest.approx(target.position_mm, abs=0.2)


def test_a_robot_that_was_not_commanded_is_not_moved_by_a_hold(robot):
    enable(robot)
    before = robot.read()
    robot.hold(time.monotonic_ns())
    until(lambda: robot.read().number > before.number + 20, "no more readings")
    assert robot.read().pose.position_mm == pytest.approx(before.pose.position_mm, abs=0.2)


def test_a_robot_can_be_closed_twice_even_while_it_moves(robot):
    enable(robot)
    moved(robot)
    robot.close()
    robot.close()


@pytest.mark.parametrize("uri", ["arm", "crtk:", "crtk:a b", "servo:", "servo:node?tip=tool0"])
def test_an_invalid_robot_is_refused_in_one_sentence(uri, ros_network):
    with pytest.raises(BadInput) as refused:
        open_robot(uri, MonotonicClock())
    assert len(str(refused.value)) > 20
