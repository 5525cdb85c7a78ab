"""`haptigraph robot check` against a simulated arm in another process, over DDS."""

import json
import subprocess
import sys
import threading
import uuid
from contextlib import contextmanager

import pytest
from ros_network import robot_peer

pytest.importorskip("cyclonedds")

from crtk_messages import SABOTAGES

from haptigraph.errors import BadInput
from haptigraph.robot.check_report import checked
from haptigraph.robot.checking.listening import listener

pytestmark = pytest.mark.realtime

SETUP = """
format = 1
[rcm]
at_mm = [20.0, -30.0, 100.0]
[eye]
translation_mm = [20.0, -30.0, 88.0]
quaternion = [0.0, 0.0, 0.0, 1.0]
"""


@contextmanager
def moved_by_hand(*arguments):
    """A robot that is about to be moved by hand for 8 s; its URI."""
    name = f"arm_{uuid.uuid4().hex}"
    with robot_peer("crtk", f"/{name}", "hand", *arguments) as process:
        threading.Thread(target=process.stdout.read, daemon=True).start()
        yield f"crtk:{name}"


def check(uri, setup, *options, seconds=6):
    """Exit code, output and report of a check."""
    command = [sys.executable, "-m", "haptigraph", "robot", "check", uri, "--setup", setup, *options]
    ended = subprocess.run([*command, "--seconds", str(seconds)], capture_output=True, text=True, timeout=120)
    report = setup.with_name("robot_check.json")
    return ended, json.loads(report.read_text()) if report.exists() else None


@pytest.fixture
def setup(tmp_path, ros_network):
    path = tmp_path / "robot.toml"
    path.write_text(SETUP)
    return path


def test_a_sound_robot_is_refused_before_and_steered_after_its_check(setup):
    setup.write_text(f"{SETUP}[limits]\nstale_ms = 1000.0\n")  # on a machine that others use, too
    with moved_by_hand(11) as uri:
        with pytest.raises(BadInput, match="has not been checked"):
            checked(uri, setup)
        ended, report = check(uri, setup, "--enable", "--json", setup.with_name("copy.json"))
    assert ended.returncode == 0, ended.stdout + ended.stderr
    checked(uri, setup)
    assert f"{uri} passed" in ended.stdout
    assert "Research software, not a medical device" in ended.stdout
    assert report["measurements"]["enabled_ms"] > 0
    assert report["measurements"]["command_echo_ms"] > 0
    assert json.loads(setup.with_name("copy.json").read_text()) == report


def test_nobody_is_there(setup):
    ended, report = check(f"crtk:arm_{uuid.uuid4().hex}", setup, seconds=3)
    assert ended.returncode == 1
    names = {found["name"] for found in report["findings"]}
    assert names == {"command_type", "state_missing", "pose_missing"}
    assert not report["passed"]


@pytest.mark.parametrize("uri", ["simulated", "arm:1", "crtk:"])
def test_what_cannot_be_checked_is_refused(uri, ros_network):
    with pytest.raises(BadInput, match=r"valid|needs"):
        listener(uri)


def test_servo_is_enabled_by_its_user(ros_network):
    opened = listener("servo:servo_node")
    with pytest.raises(BadInput, match="MoveIt Servo is enabled by its services"):
        opened.enable()
    opened.close()


@pytest.mark.slow
@pytest.mark.parametrize("name", SABOTAGES)
def test_every_sabotage_is_found_over_the_network(setup, name):
    with moved_by_hand(12, name) as uri:
        ended, report = check(uri, setup)
    assert ended.returncode == 1
    names = [found["name"] for found in report["findings"]]
    sys.stdout.write(f"{name}: {names}\n")
    assert SABOTAGES[name][0] in names
