"""haptigraph devices: the available devices, missing extras, and a device that plays the grammar."""

import sys
from itertools import groupby

import pytest
from firmata_board import Board
from haptic_driver import DriverBoard
from helpers import LOW, MS, PULSE, SUCCESS, call, refuse
from made_profiles import TEXT

from haptigraph import assemble
from haptigraph.analysis.actuators import play_grammar
from haptigraph.clock import VirtualClock
from haptigraph.haptics.profiles.profile import parse_profile
from haptigraph.messages import OFF, Capabilities


class Actuator:
    capabilities = Capabilities(255, None, 100.0, answers=True)

    def __init__(self):
        self.commands, self.closed = [], 0

    def set(self, amplitude, frequency_hz, stamp_ns):
        self.commands.append((stamp_ns / MS, amplitude))

    def close(self):
        self.closed += 1


def test_every_device_is_listed():
    listed = call("devices").stdout
    for kind, path in assemble.DEVICES.items():
        assert kind in listed, path
    assert "haptigraph live" in listed
    assert "Research software" in listed


def test_missing_extras_are_named(monkeypatch):
    for module in ("sdl2", "serial", "serial.tools", "sounddevice"):
        monkeypatch.setitem(sys.modules, module, None)
    listed = " ".join(call("devices").stdout.replace("│", " ").split())
    for extra in ("audio", "gamepad", "serial"):
        assert f"haptigraph[{extra}]" in listed


def test_a_device_plays_the_grammar_through_the_guard_and_is_closed():
    actuator, lines = Actuator(), []
    test = play_grammar(actuator, (OFF, LOW, PULSE, SUCCESS), VirtualClock(), lines.append)
    edges = [(ms, amplitude) for ms, amplitude in actuator.commands if amplitude]
    assert [amplitude for _, amplitude in edges] == [0.3] + 9 * [1.0] + 2 * [0.8]
    assert edges[2][0] - edges[1][0] == 180  # 100 ms on, the device's shortest, and the original pause
    assert actuator.commands[-1][1] == 0
    assert actuator.closed == 1
    assert test.count == len(actuator.commands)
    assert "80 ms on, 80 ms off become 100 on, 80 off" in lines[1]


def test_a_profile_gives_the_drives_and_the_shortest_burst():
    actuator, lines, profile = Actuator(), [], parse_profile(TEXT, "p.toml")
    play_grammar(actuator, (LOW, PULSE), VirtualClock(), lines.append, profile)
    edges = [(ms, drive) for ms, drive in actuator.commands if drive]
    assert edges[0][1] == profile.drive_at(0.3) > 0.3 and edges[1][1] == 1.0
    assert edges[2][0] - edges[1][0] == 160  # bursts of 80 ms are long enough by the profile
    assert "become" not in lines[1]


def answered_in_time(run, make_board, words):
    """Return a board and what a command printed on it that ended well; a busy machine may delay an answer for too long."""
    for _ in range(3):
        with make_board() as board:
            output = run(board)
            if words in output:
                return board, output
    raise AssertionError(output)


@pytest.mark.realtime
def test_a_board_plays_the_grammar_and_its_round_trip_is_measured(tmp_path):
    pytest.importorskip("serial")
    board, _ = answered_in_time(
        lambda board: call("devices", "test", f"serial:{board.link}").stdout,
        lambda: Board(tmp_path / "tty"),
        "confirmed each one, so this is the round trip",
    )
    values = [value for _, _, value in board.edges if value]
    assert [value for value, _ in groupby(values)] == [76, 255, 204]
    assert 5 < values.count(255) <= 20  # a busy machine may miss one of the 10 pulses, or split each in two
    assert not board.vibrates()


@pytest.mark.realtime
def test_a_driver_measures_its_motor_and_the_option_restores_the_result(tmp_path):
    pytest.importorskip("serial")
    options = "?motor=lra&mux=0x70&channel=0,1"
    board, output = answered_in_time(
        lambda board: call("devices", "auto-calibrate", f"drv2605:{board.link}{options}").stdout,
        lambda: DriverBoard(tmp_path / "tty"),
        "driver 2: compensation 13, back EMF 110, gain 1, resonance 175 Hz",
    )
    option = output.split()[-1]
    assert option == "&calibration=13-110-1,13-110-1"
    assert not board.vibrates()
    with DriverBoard(tmp_path / "tty") as board:
        assemble.open_device(f"drv2605:{board.link}{options}{option}").close()
        assert bytes(board.drivers[1].registers[0x18:0x1A]) == bytes((13, 110))


def test_other_devices_do_not_measure_their_motor():
    assert "only a drv2605 measures its motor, found gamepad" in refuse(
        "devices", "auto-calibrate", "gamepad:0"
    )


def test_a_device_that_does_not_open_is_refused_in_one_sentence():
    assert "unknown device 'glove'" in refuse("devices", "test", "glove")
    assert "cannot be opened (No such file or directory)" in refuse("devices", "test", "serial:/dev/nowhere")


def test_a_device_that_fails_is_reported(tmp_path, monkeypatch):
    def set(self, amplitude, frequency_hz, stamp_ns):
        raise OSError("unplugged")

    monkeypatch.setattr("haptigraph.haptics.trace.TraceDevice.set", set)
    result = call("devices", "test", f"trace:{tmp_path / 'touch.csv'}")
    assert result.exit_code == 2
    assert "unplugged" in result.stderr
