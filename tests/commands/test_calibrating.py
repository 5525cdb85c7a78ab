"""`haptigraph devices calibrate`: a simulated person at the keys, through the real guard."""

import os
import pty
import select
import subprocess
import sys
import termios
import threading
from contextlib import ExitStack, suppress

import click
import pytest
from firmata_board import Board
from helpers import call, refuse

from haptigraph.clock import VirtualClock
from haptigraph.errors import DeviceError
from haptigraph.haptics.profiles.measuring import NUMBER, Burst, Trial
from haptigraph.haptics.profiles.profile import load_profile
from haptigraph.messages import Capabilities
from haptigraph.study.simulated.device_calibration import SimulatedActuator, SimulatedHand
from haptigraph.study.simulated.participant import draw_participant

ACTUATORS = {
    "device": SimulatedActuator(lambda drive: 0.8 * drive**1.3, 20.0),
    "reference": SimulatedActuator(lambda drive: drive),
}
URIS = {"serial:board": "device", "audio": "reference"}
ARGUMENTS = ("--by", "S1", "--description", "simulated")


class Felt:
    """A simulated device: a log of its bursts, as (output, drive, duration)."""

    def __init__(self, name, log, **capabilities):
        self.name, self.log = name, log
        self.capabilities = Capabilities(**{"amplitude_levels": 255, "frequency_range_hz": None, "shortest_on_ms": 50.0} | capabilities)  # fmt: skip
        self.on, self.closed, self.fails_after = None, False, None

    def set(self, amplitude, frequency_hz, stamp_ns):
        if self.fails_after is not None and len(self.log) >= self.fails_after:
            raise DeviceError("the board does not respond")
        if self.on is not None:
            self.log.append(Burst(self.name, self.on[0], (stamp_ns - self.on[1]) / 1e6))
        self.on = (amplitude, stamp_ns) if amplitude else None

    def close(self):
        self.closed = True
        self.on = None


class Person:
    """Answers from what was played since the last answer; `stops_after` questions it presses Ctrl-C."""

    def __init__(self, seed=1, stops_after=10_000):
        self.hand = SimulatedHand(draw_participant(1, 0), ACTUATORS, seed)
        self.devices, self.log, self.bursts = {}, [], []
        self.questions, self.stops_after, self.agreed_after = 0, stops_after, None

    def open(self, uri):
        self.devices[uri] = Felt(URIS[uri], self.log, answers=uri.startswith("serial"))
        return self.devices[uri]

    def agree(self, text, **options):
        self.agreed_after = len(self.log)
        return True

    def _answer(self, choices, *task):
        self.questions += 1
        if self.questions > self.stops_after:
            raise KeyboardInterrupt
        bursts, self.log[:] = list(self.log), []
        self.bursts += bursts
        bursts = bursts or [Burst("device", 0.0)]
        if choices == NUMBER and len(bursts) < 2:
            bursts.append(Burst("device", 0.0))
        return self.hand(Trial(*task, 1, 1, tuple(bursts), "", choices))

    def key(self):
        return (
            self._answer(("1", "2"), "match") if len(self.log) == 2 else self._answer(("y", "n"), "threshold")
        )

    def number(self, text, default=None, **options):
        return default if default is not None else self._answer(NUMBER, "rate")


@pytest.fixture
def person(monkeypatch):
    person = Person()
    monkeypatch.setattr("haptigraph.assemble.open_device", lambda uri: person.open(uri))
    monkeypatch.setattr("haptigraph.clock.MonotonicClock", VirtualClock)
    for name, answer in (("getchar", person.key), ("prompt", person.number), ("confirm", person.agree)):
        monkeypatch.setattr(click, name, answer)
    return person


@pytest.mark.parametrize("reference", [(), ("--reference", "audio")], ids=["rated", "matched"])
def test_a_person_at_the_keys_writes_a_profile_that_check_reads(person, tmp_path, reference):
    path = tmp_path / "motor.toml"
    result = call("devices", "calibrate", "serial:board", "-o", path, *ARGUMENTS, *reference)
    assert result.exit_code == 0, result.output
    assert person.agreed_after == 0  # nothing vibrated before
    profile = load_profile(path)
    assert profile.device.uri == "serial:board" and profile.intensity.scale == (
        "audio" if reference else "own"
    )
    assert profile.latency is not None and profile.latency.basis == "measured"
    true = 0.8 if reference else 1.0
    assert profile.strongest == pytest.approx(true, rel=0.35)
    assert all(device.closed for device in person.devices.values())
    assert "one person on one day" in result.stdout
    checked = call("check", "--profile", path)
    assert checked.exit_code in (0, 1) and "by its profile" in checked.stdout


def test_the_largest_drive_is_never_exceeded_and_is_the_last_point(person, tmp_path):
    path = tmp_path / "motor.toml"
    call("devices", "calibrate", "serial:board", "-o", path, *ARGUMENTS, "--max-drive", "0.6")
    assert max(burst.drive for burst in person.bursts) == pytest.approx(0.6)
    assert load_profile(path).intensity.point[-1].drive == pytest.approx(0.6)


@pytest.mark.parametrize("questions", [0, 30, 60, 100])
def test_ctrl_c_silences_the_device_and_writes_nothing(person, tmp_path, questions):
    person.stops_after = questions
    path = tmp_path / "motor.toml"
    path.write_text("mine")
    result = call("devices", "calibrate", "serial:board", "-o", path, *ARGUMENTS, "--force")
    assert result.exit_code == 130
    assert person.devices["serial:board"].closed and person.devices["serial:board"].on is None
    assert path.read_text() == "mine" and list(tmp_path.iterdir()) == [path]


def test_without_agreement_nothing_vibrates(person, tmp_path, monkeypatch):
    def refused(text, **options):
        raise click.Abort

    monkeypatch.setattr(click, "confirm", refused)
    result = call("devices", "calibrate", "serial:board", "-o", tmp_path / "motor.toml", *ARGUMENTS)
    assert result.exit_code == 1 and not person.log and person.devices["serial:board"].closed
    assert not list(tmp_path.iterdir())


def test_a_device_that_fails_ends_the_calibration_in_one_sentence(person, tmp_path, monkeypatch):
    opened = person.open

    def failing(uri):
        device = opened(uri)
        device.fails_after = 1
        return device

    monkeypatch.setattr("haptigraph.assemble.open_device", failing)
    result = call("devices", "calibrate", "serial:board", "-o", tmp_path / "motor.toml", *ARGUMENTS)
    assert result.exit_code == 2 and "does not respond" in result.stderr and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("console", "-o", "a.toml"), "console is not felt"),
        (("serial:board", "-o", "a.txt"), "ends in .toml"),
        (("serial:board", "-o", "none/a.toml"), "its folder does not exist"),
        (("serial:board", "-o", "there.toml"), "exists already; --force overwrites it"),
        (
            ("serial:board", "-o", "a.toml", "--reference", "serial:board"),
            "compare serial:board with another",
        ),
        (("serial:board", "-o", "a.toml", "--reference", "trace:x.csv"), "trace:x.csv is not felt"),
    ],
)
def test_what_cannot_be_measured_or_written_is_one_sentence(
    person, tmp_path, monkeypatch, arguments, sentence
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.toml").touch()
    assert sentence in refuse("devices", "calibrate", *arguments, *ARGUMENTS)
    assert not person.devices


def test_a_device_that_only_knows_on_and_off_is_refused(person, tmp_path, monkeypatch):
    monkeypatch.setattr("haptigraph.assemble.open_device", lambda uri: Felt("device", [], amplitude_levels=1))
    sentence = refuse("devices", "calibrate", "serial:board", "-o", tmp_path / "a.toml", *ARGUMENTS)
    assert "only knows on and off" in sentence


def test_without_a_terminal_there_are_no_keys(person, tmp_path, monkeypatch):
    monkeypatch.setattr(click, "getchar", lambda: "")
    result = call("devices", "calibrate", "serial:board", "-o", tmp_path / "a.toml", *ARGUMENTS)
    assert result.exit_code == 2 and "needs a terminal" in result.stderr


class Unresponsive(Exception):
    """The machine was too busy for the simulated board to answer in time, so the command gave up."""


@pytest.mark.realtime
def test_in_a_real_terminal_keys_answer_and_ctrl_c_ends_in_silence(tmp_path):
    pytest.importorskip("serial")
    path = tmp_path / "motor.toml"
    for attempt in range(5):
        with suppress(Unresponsive), Board(tmp_path / f"tty{attempt}") as board:
            _press_keys(board, path)
            break
    assert any(value for _, _, value in board.edges) and not board.vibrates()
    assert not path.exists()


def _press_keys(board, path):
    """Answer once in a terminal, then press Ctrl-C."""
    terminal, its_end = pty.openpty()
    arguments = ("devices", "calibrate", f"serial:{board.link}", "-o", str(path), *ARGUMENTS)
    program = [sys.executable, "-m", "haptigraph", *arguments]
    with ExitStack() as stack:
        for each in (terminal, its_end):
            stack.callback(os.close, each)
        process = subprocess.Popen(program, stdin=its_end, stdout=its_end, stderr=its_end)
        stack.enter_context(process)
        stack.callback(process.kill)
        for expected, key in (("agree", b"y\n"), ("Enter", b"\n"), ("1 of 40", b"y"), ("2 of 40", b"\x03")):
            _read_until(terminal, expected)
            if expected in ("agree", "Enter"):
                assert not any(value for _, _, value in board.edges)
            if not key.endswith(b"\n"):
                _await_raw(its_end)
            os.write(terminal, key)
        assert process.wait(60) == 130


def _await_raw(terminal):
    """Wait until single keys are read; what was typed before is discarded."""
    for _ in range(6000):
        if not termios.tcgetattr(terminal)[3] & termios.ICANON:
            return
        threading.Event().wait(0.01)
    raise AssertionError("the program does not read keys")


def _read_until(terminal, expected):
    shown = b""
    while expected.encode() not in shown:
        assert select.select([terminal], [], [], 60)[0], shown
        shown += os.read(terminal, 4096)
        if b"does not respond" in shown:
            raise Unresponsive
