"""Who moves a robot from a page, and with what; the robot is a double with the members of `RobotProcess`."""

import asyncio
import json
import math

import pytest
from event_loop import run_in_thread

from haptigraph.clock import VirtualClock
from haptigraph.dashboard.server import access
from haptigraph.dashboard.server.controls import Controls
from haptigraph.dashboard.server.hub import Hub
from haptigraph.dashboard.server.robot_control import RobotControl
from haptigraph.dashboard.server.viewer import Viewer
from haptigraph.robot.interface import Operating, RobotReading
from haptigraph.robot.messages import MotionStatus
from haptigraph.robot.pose import ToolPose
from haptigraph.robot.simulated import EXAMPLE_SETUP
from haptigraph.run_robot import SteeredRobot
from haptigraph.teleop.motion import HandMotion, TeleopSettings

MOVE, RELEASED = HandMotion(True, 1.0), HandMotion(False)


class Robot:
    """A robot that notes what it is asked for."""

    uri, has_jaws = "crtk:PSM1", False

    def __init__(self):
        self.settings = TeleopSettings()
        self.done = []

    def put(self, motion):
        self.done.append(motion)

    def set_enabled(self, on):
        self.done.append(on)

    def status(self):
        reading = RobotReading(0, 0, ToolPose((1.0, 2.0, 3.0)), Operating("PAUSED", True, False))
        reasons = ("the robot is not enabled, homed and idle",)
        return MotionStatus(False, reasons, True, reading, 200.0, 0, math.nan, math.nan, math.nan)


@pytest.fixture
def clock():
    return VirtualClock(5_000_000_000)


@pytest.fixture
def hub(clock):
    return Hub(clock)


@pytest.fixture
def robot():
    return Robot()


def controls_of(hub, robot, **options):
    return Controls(hub, None, None, RobotControl(hub, SteeredRobot(robot, EXAMPLE_SETUP, 0.0), **options))


def texts(viewer):
    return [json.loads(text) for text in viewer._texts]


@pytest.mark.parametrize(
    ("may_steer", "is_local", "allows_remote", "moves"),
    [
        (True, True, False, True),
        (True, False, False, False),
        (True, False, True, True),
        (False, True, True, False),
        (False, False, True, False),
    ],
)
def test_a_page_elsewhere_moves_a_robot_only_if_that_is_allowed(
    hub, robot, may_steer, is_local, allows_remote, moves
):
    def act():
        controls = controls_of(hub, robot, allows_remote=allows_remote)
        viewer = Viewer("page 1", may_steer=may_steer, is_local=is_local)
        controls.take(viewer)
        controls.switch(viewer, on=True)
        controls.move(viewer, MOVE, hub.now_ms())
        return texts(viewer)

    errors = run_in_thread(run(act))
    assert robot.done == ([RELEASED, True, MOVE] if moves else [])
    if may_steer and not moves:
        assert "127.0.0.1, or start haptigraph with --allow-remote-motion" in errors[-1]["message"]


async def run(act):
    return act()


def test_only_the_page_that_has_the_controls_moves_and_switches(hub, robot):
    def act():
        controls = controls_of(hub, robot)
        first, second = Viewer("page 1", is_local=True), Viewer("page 2", is_local=True)
        controls.take(first)
        controls.take(second)
        controls.switch(second, on=True)
        controls.move(second, MOVE, hub.now_ms())

    run_in_thread(run(act))
    assert robot.done == []


@pytest.mark.parametrize(
    ("age_ms", "passed"), [(0.0, MOVE), (99.0, MOVE), (101.0, RELEASED), (-101.0, RELEASED), (None, RELEASED)]
)
def test_a_message_that_was_delayed_is_a_release(hub, robot, age_ms, passed):
    def act():
        controls, viewer = controls_of(hub, robot), Viewer("page 1", is_local=True)
        controls.take(viewer)
        controls.move(viewer, MOVE, None if age_ms is None else hub.now_ms() - age_ms)

    run_in_thread(run(act))
    assert robot.done == [passed]


@pytest.mark.parametrize("sent_ms", [math.nan, math.inf])
def test_a_message_of_no_valid_time_is_a_release(hub, robot, sent_ms):
    control = RobotControl(hub, SteeredRobot(robot, EXAMPLE_SETUP, 0.0))
    control.put(MOVE, sent_ms)
    assert robot.done == [RELEASED]


def test_giving_up_the_controls_releases_and_switches_off(hub, robot):
    def act():
        controls, viewer = controls_of(hub, robot), Viewer("page 1", is_local=True)
        controls.take(viewer)
        controls.switch(viewer, on=True)
        robot.done.clear()
        controls.release(viewer)
        controls.switch(viewer, on=True)  # ignored now

    run_in_thread(run(act))
    assert robot.done == [RELEASED, RELEASED, False]


def test_settings_of_the_hand_are_the_robots(hub, robot):
    def act():
        controls, viewer = controls_of(hub, robot), Viewer("page 1", is_local=True)
        controls.take(viewer)
        controls.tune(viewer, {"motion_scale": 0.05})

    run_in_thread(run(act))
    assert robot.settings.motion_scale == 0.05


def test_every_page_receives_the_state_and_the_reasons(hub, robot):
    async def act():
        viewer = Viewer("page 1")
        hub.join(viewer)
        pump = asyncio.create_task(RobotControl(hub, SteeredRobot(robot, EXAMPLE_SETUP, 0.0)).pump())
        message = json.loads(await asyncio.wait_for(viewer.next(), 30))
        pump.cancel()
        return message

    message = run_in_thread(act())
    assert message == {
        "type": "robot",
        "uri": "crtk:PSM1",
        "is_moving": False,
        "is_switched_on": True,
        "reasons": ["the robot is not enabled, homed and idle"],
        "state": "PAUSED",
        "is_homed": True,
        "tip_mm": [1.0, 2.0, 3.0],
        "rate_hz": 200.0,
        "late": 0,
        "error": "",
    }


@pytest.mark.parametrize(
    ("client", "headers", "expected"),
    [
        (("127.0.0.1", 5), {}, True),
        (("127.8.0.1", 5), {}, True),
        (("::1", 5), {}, True),
        (("::ffff:127.0.0.1", 5), {}, True),
        (("192.0.2.7", 5), {}, False),
        (("::ffff:192.0.2.7", 5), {}, False),
        (None, {}, False),
        (("192.0.2.7", 5), {"X-Forwarded-For": "127.0.0.1"}, False),
        (("192.0.2.7", 5), {"Host": "127.0.0.1:8000", "Origin": "http://127.0.0.1:8000"}, False),
        (("127.0.0.1", 5), {"X-Forwarded-For": "192.0.2.7"}, False),
        (("127.0.0.1", 5), {"Forwarded": "for=192.0.2.7"}, False),
        (("127.0.0.1", 5), {"Via": "1.1 proxy"}, False),
    ],
)
def test_only_the_address_of_the_sender_makes_a_page_local(client, headers, expected):
    encoded = [(name.lower().encode(), value.encode()) for name, value in headers.items()]
    assert access.is_local({"client": client, "headers": encoded}) is expected
