import os
import sys

import pytest

pytest.importorskip("termios")

import termios

from leader_rigs import KeysRig
from ros_network import until

from haptigraph.clock import VirtualClock
from haptigraph.errors import BadInput, DeviceError
from haptigraph.teleop.leaders import keys
from haptigraph.teleop.leaders.keys import KeysLeader

PRESS_MM = 1.0
"""How far the hand moves with one press: 100 ms at 10 mm/s."""


@pytest.fixture
def rig():
    rig = KeysRig()
    yield rig
    rig.close()


def press(rig, data):
    os.write(rig.hand, data)
    until(rig._is_readable, "no key")
    return rig.leader.take()


@pytest.mark.parametrize(
    ("data", "axis", "sign"),
    [
        (b"\x1b[B", "along_mm", 1),
        (b"\x1bOA", "along_mm", -1),
        (b"d", "across_mm", 1),
        (b"a", "across_mm", -1),
        (b"r", "outwards_mm", 1),
        (b"f", "outwards_mm", -1),
        (b"o", "apart_mm", 1),
    ],
)
def test_one_press_moves_for_a_tenth_of_a_second(rig, data, axis, sign):
    press(rig, data)
    moved_mm = 0.0
    for _ in range(30):
        rig.wait(10)
        (motion,) = rig.leader.take()
        moved_mm += getattr(motion, axis)
    assert moved_mm == pytest.approx(sign * PRESS_MM)
    assert not motion.engaged


def test_a_key_that_repeats_moves_on(rig):
    moved_mm = 0.0
    for _ in range(20):
        moved_mm += sum(motion.along_mm for motion in press(rig, b"s"))
        rig.wait(30)
    assert moved_mm == pytest.approx(0.3 * 19)


def test_the_last_key_of_a_burst_counts(rig):
    press(rig, b"wwwwwwww" * 10 + b"s")
    rig.wait(500)
    (motion,) = rig.leader.take()
    assert motion.along_mm == pytest.approx(PRESS_MM)


def test_a_sequence_may_arrive_in_parts(rig):
    press(rig, b"\x1b")
    press(rig, b"[B")
    rig.wait()
    (motion,) = rig.leader.take()
    assert motion.along_mm > 0


@pytest.mark.parametrize(
    "data", [b"x", b"\x1b[5~", b"\x1b", b"\x00\xff\xfe", "λ".encode(), b"\x1b[", b"\x04"]
)
def test_other_keys_move_nothing(rig, data):
    assert not press(rig, data)[0].engaged
    rig.wait()
    assert not rig.leader.take()[0].engaged


def test_the_terminal_is_restored(rig):
    during = termios.tcgetattr(rig.terminal)
    assert not during[3] & termios.ICANON and during[3] & termios.ISIG  # Ctrl-C still ends the program
    rig.leader.close()
    assert termios.tcgetattr(rig.terminal)[3] & termios.ICANON


def test_a_closed_terminal_is_reported(rig):
    rig.lose()
    with pytest.raises(DeviceError, match="the terminal is closed"):
        rig.leader.take()


@pytest.mark.parametrize("stdin", [None, "pipe"])
def test_without_a_terminal_it_is_refused(monkeypatch, stdin):
    read, write = os.pipe()
    with os.fdopen(read) as pipe, os.fdopen(write, "w"):
        monkeypatch.setattr(sys, "stdin", pipe if stdin else None)
        with pytest.raises(BadInput, match="leader keys needs a terminal; standard input is none"):
            KeysLeader("", VirtualClock())


def test_on_windows_it_is_refused(monkeypatch):
    monkeypatch.setattr(keys, "termios", None)
    with pytest.raises(BadInput, match="needs a terminal of Linux or macOS; use gamepad:0"):
        KeysLeader("", VirtualClock())
