"""The original sketch, as compiled by its authors for an Arduino Uno, on a simulated processor.

Needs a C compiler, libsimavr and the .hex file of the sketch, which the npm package avrgirl-arduino contains:

    apt-get install gcc libsimavr-dev libelf-dev && npm pack avrgirl-arduino@5.0.1 && tar xzf avrgirl-arduino-*.tgz
    HAPTIGRAPH_UNO_HEX=package/junk/hex/uno/StandardFirmata.cpp.hex pytest tests/haptics/boards/test_firmata_uno.py
"""

import os
import subprocess
import threading
from pathlib import Path

import pytest
from helpers import LOW, PULSE, SUCCESS

from haptigraph.analysis.actuators import play_grammar
from haptigraph.clock import MonotonicClock
from haptigraph.errors import BadInput
from haptigraph.haptics.boards import board as boards
from haptigraph.haptics.boards import drv2605
from haptigraph.haptics.boards.drv2605 import Drv2605Device
from haptigraph.haptics.boards.pwm import PwmDevice

HEX = os.environ.get("HAPTIGRAPH_UNO_HEX")
SOURCE = Path(__file__).parent / "uno" / "uno.c"

pytest.importorskip("serial")
pytestmark = pytest.mark.skipif(
    HEX is None, reason="needs HAPTIGRAPH_UNO_HEX; see the docstring of this file"
)


@pytest.fixture
def uno(tmp_path, request):
    """The port of a running Uno; the duty cycle of its pin 9 and what two drivers play, at every change."""
    program = tmp_path / "uno"
    subprocess.run(["cc", "-O2", SOURCE, "-o", program, "-lsimavr", "-lelf"], check=True)
    levels = []
    with subprocess.Popen(
        [program, HEX, *getattr(request, "param", ())],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as board:
        port = board.stdout.readline().strip()
        reader = threading.Thread(
            target=lambda: levels.extend(tuple(map(int, line.split()[1:])) for line in board.stdout)
        )
        reader.start()
        yield port, levels
        board.kill()
        reader.join()


@pytest.fixture(autouse=True)
def patience(monkeypatch):
    """A simulated processor may be ten times slower than a real one."""
    monkeypatch.setattr(boards, "RESPONSE_S", 5.0)
    monkeypatch.setattr(drv2605, "RESPONSE_S", 5.0)
    monkeypatch.setattr(boards, "SETUP_S", 20.0)
    monkeypatch.setattr(boards, "BOOT_S", 60.0)


def test_the_stock_sketch_plays_the_grammar(uno):
    port, levels = uno
    trial = play_grammar(PwmDevice(port), (LOW, PULSE, SUCCESS), MonotonicClock(), lambda line: None)
    assert trial.faults == []
    levels = [pin for pin, _, _ in levels]
    low, pulses, bursts = levels.index(255), levels.index(204), len(levels)
    assert levels[:low] == [76, 0]
    assert set(levels[low:pulses]) == {255, 0}
    assert 5 <= levels[low:pulses].count(255) <= 10
    assert levels[pulses:bursts] == [204, 0, 204, 0]


def test_the_stock_sketch_reports_which_pins_support_pwm(uno):
    port, _ = uno
    with pytest.raises(BadInput, match="pin 7 does not support PWM; use one of 3, 5, 6, 9, 10, 11"):
        PwmDevice(f"{port}?pin=7")


TWO_DRIVERS = "?motor=lra&rated_v=1.8&mux=0x70&channel=0,1"


def test_the_stock_sketch_plays_on_both_drivers_behind_the_multiplexer(uno):
    port, levels = uno
    device = Drv2605Device(f"{port}{TWO_DRIVERS}&enable=7")
    for value in (0, 76, 255, 1, 204, 0):
        device.set(value / 255, 0.0, 0)
    device.close()
    assert [played[0] for played in zip(*levels, strict=True)] == [0, 76, 76]
    assert [first for _, first, second in levels if first == second] == [76, 255, 1, 204, 0]


@pytest.mark.parametrize("uno", [("deaf",)], indirect=True)
def test_the_stock_sketch_repeats_old_bytes_for_a_driver_that_does_not_answer_and_it_is_noticed(uno):
    port, levels = uno
    with pytest.raises(BadInput, match=r"nothing answers at the I2C address 0x5a \(I2C"):
        Drv2605Device(f"{port}{TWO_DRIVERS}")
    assert all(played == (0, 0, 0) for played in levels)
