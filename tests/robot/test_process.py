"""A robot in a process of its own, as a program sees it. Its faults: tests/faults/test_robot_faults.py."""

import time
from contextlib import closing

import pytest
from paths import ROOT

from haptigraph.errors import BadInput, DeviceError
from haptigraph.robot.gate import HOLDS
from haptigraph.robot.process import RobotProcess
from haptigraph.teleop.motion import HandMotion, TeleopSettings

pytestmark = pytest.mark.realtime
SETUP = ROOT / "examples" / "robot.toml"
WAIT_S = 30.0


def until(condition) -> None:
    give_up_s = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < give_up_s, "not in time"
        time.sleep(0.01)


@pytest.fixture
def robot():
    with closing(RobotProcess("simulated:1", SETUP, TeleopSettings(motion_scale=0.5))) as process:
        yield process


def test_it_starts_held_and_names_the_reasons(robot):
    until(lambda: robot.status().reading is not None and robot.status().reading.pose is not None)
    status = robot.status()
    assert not status.is_moving and not status.is_switched_on
    assert HOLDS["is_switched_on"] in status.reasons
    assert status.reading.operating.state == "DISABLED"


def test_every_reading_is_passed_on_once_and_in_order(robot):
    readings = []
    until(lambda: readings.extend(robot.take_readings()) or len(readings) > 50)
    numbers = [reading.number for reading in readings]
    assert numbers == sorted(set(numbers))
    stamps = [reading.stamp_ns for reading in readings]
    assert stamps == sorted(stamps)
    assert abs(time.monotonic_ns() - stamps[-1]) < WAIT_S * 1e9  # on this machine's clock


def test_it_fits_where_a_hand_is_put_and_takes_settings(robot):
    assert robot.settings.motion_scale == 0.5 and not robot.has_jaws
    robot.put(HandMotion(True))
    until(lambda: robot.hand.engaged)
    assert robot.hand.motion_scale == 0.5
    robot.settings = TeleopSettings(motion_scale=0.25)
    assert robot.settings.motion_scale == 0.25
    until(lambda: robot.hand.motion_scale == 0.25)


def test_requests_reach_the_robot(robot):
    robot.request("enable")
    until(lambda: robot.status().reading.operating.state == "ENABLED")


def test_an_unchecked_robot_is_read_and_never_moved(tmp_path, monkeypatch):
    import haptigraph.robot.process as module

    program = "from haptigraph.robot import loop; loop._is_checked = lambda *_: False; loop.main()"
    monkeypatch.setattr(module, "PROGRAM", [module.program_of("x")[0], "-P", "-c", program])
    with closing(RobotProcess("simulated:1", SETUP)) as robot:
        until(lambda: HOLDS["is_checked"] in robot.status().reasons)
        until(robot.take_readings)


def test_a_process_that_ends_before_it_opens_is_refused_without_a_wait(monkeypatch):
    import haptigraph.robot.process as module

    monkeypatch.setattr(module, "PROGRAM", [module.program_of("x")[0], "-c", "raise SystemExit(1)"])
    began_s = time.monotonic()
    with pytest.raises(BadInput, match="simulated:1 does not open"):
        RobotProcess("simulated:1", SETUP)
    assert time.monotonic() - began_s < module.START_S / 2


def test_after_its_end_it_is_reported_and_may_be_closed_twice():
    robot = RobotProcess("simulated:1", SETUP)
    robot._process.kill()
    until(lambda: robot.status().reasons == ("the robot's process has ended",))
    robot.put(HandMotion(True, 1.0))
    robot.set_enabled(True)
    assert not robot.status().is_moving and robot.status().rate_hz == 0
    with pytest.raises(DeviceError, match="simulated:1: its process had ended with -9; it may keep"):
        robot.close()
    robot.close()
