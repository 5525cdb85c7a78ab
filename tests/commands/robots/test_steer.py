import os
import signal

import pytest
from click.testing import CliRunner
from helpers import refuse
from paths import ROOT

from haptigraph.cli import main
from haptigraph.robot.setup import load_setup
from haptigraph.robot.simulated import EXAMPLE_SETUP
from haptigraph.teleop.motion import HandMotion

pytestmark = pytest.mark.realtime
SETUP = ROOT / "examples" / "robot.toml"


CALLS = 150
ON, OFF = "motion is on; Ctrl-C switches it off", "motion is off"


class Hand:
    """A leader that moves once its clutch was released and pressed, then has Ctrl-C pressed, again and again."""

    def __init__(self, argument, clock):
        self.calls = 0

    def take(self):
        self.calls += 1
        if self.calls % CALLS == 0:
            os.kill(os.getpid(), signal.SIGINT)
        return [HandMotion(self.calls % CALLS > 5, 0.01)]

    def close(self):
        pass


@pytest.fixture
def hand(monkeypatch):
    monkeypatch.setattr("haptigraph.teleop.leaders.opening._class", lambda kind: Hand)


def steer(*lines: str, uri: str = "simulated:1"):
    arguments = ["robot", "steer", uri, "--setup", str(SETUP), "--leader", "hand"]
    return CliRunner().invoke(main, arguments, input="".join(f"{line}\n" for line in lines))


def test_a_hand_moves_the_robot_between_on_and_ctrl_c(hand):
    """A stall of the machine may interrupt motion before the robot moves; then it is switched on again."""
    result = steer("enable", "home", "", "on", "on", "on", "quit")
    assert result.exit_code == 0, result.output
    words = result.output.splitlines()
    assert "not a medical device" in words[0]
    assert words[1].startswith("motion is off; type on, enable")
    assert words.index("the robot is ENABLED, homed") < words.index(ON) < words.index(OFF)
    moves = [number for number, word in enumerate(words) if word == "moves with the hand"]
    assert moves
    for number in moves:
        assert [word for word in words[:number] if word in (ON, OFF)][-1] == ON
        assert OFF in words[number:]


def test_without_on_nothing_moves_and_what_is_typed_wrong_is_named(hand):
    result = steer("enable", "move")
    assert result.exit_code == 0
    assert "unknown: move; type on, enable" in result.output
    assert "motion is on" not in result.output


def test_a_robot_that_was_not_checked_is_refused():
    line = refuse("robot", "steer", "crtk:PSM1", "--setup", str(SETUP), "--leader", "keys")
    assert "crtk:PSM1 has not been checked; run haptigraph robot check" in line


def test_a_setup_without_eye_is_refused(tmp_path, hand):
    setup = tmp_path / "robot.toml"
    setup.write_text("[rcm]\nat_mm = [0.0, 0.0, 0.0]\n")
    arguments = ["robot", "steer", "simulated", "--setup", str(setup), "--leader", "hand"]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2
    assert "robot.toml has no [eye]" in result.output


def test_the_example_is_where_the_simulated_robot_is():
    example = load_setup(SETUP)
    assert example == EXAMPLE_SETUP
