"""A device in a process of its own is still when the run dies, hangs or closes."""

import os
import signal
import subprocess
import sys
from contextlib import suppress

import pytest
from firmata_board import Board

from haptigraph.errors import BadInput, DeviceError
from haptigraph.haptics.watchdog import HOLDS_MS, WatchedDevice

pytest.importorskip("serial")
FIRMATA = "haptigraph.haptics.firmata:FirmataDevice"
RUN = """
import signal
from haptigraph.haptics.watchdog import WatchedDevice
device = WatchedDevice({path!r}, {argument!r})
device.set(1.0, 80.0, 0)
{then}
"""


@pytest.fixture
def board(tmp_path):
    with Board(tmp_path / "tty") as board:
        yield board


@pytest.fixture
def device(board):
    device = WatchedDevice(FIRMATA, str(board.link))
    yield device
    device.close()


def test_it_passes_on_what_it_is_told_and_what_the_device_can(board, device):
    assert device.capabilities.amplitude_levels == 255
    assert device.capabilities.holds_ms == HOLDS_MS
    device.set(0.3, 80.0, 1)
    assert board.values[9] == 76
    device.set(0.0, 0.0, 2)
    assert not board.vibrates()


def test_it_stills_a_device_that_is_told_nothing_more(board, device):
    device.set(1.0, 80.0, 1)
    told_ns = board.edges[-1][0]
    stilled_ns = board.until(lambda board: not board.vibrates())
    assert stilled_ns - told_ns >= HOLDS_MS * 1e6 - 1e6
    device.set(1.0, 80.0, 1)  # and goes on when told again
    assert board.vibrates()


def test_it_passes_on_what_went_wrong(board, device):
    board.unplug()
    with pytest.raises(DeviceError, match=r"cannot be opened|is lost"):
        device.set(1.0, 80.0, 1)
    board.plug()
    device.set(1.0, 80.0, 1)
    assert board.vibrates()


def test_it_is_started_again_if_it_is_killed_itself(board, device):
    device.set(1.0, 80.0, 1)
    device._process.kill()
    device._process.wait()
    with suppress(DeviceError):  # it is not yet there
        device.set(0.0, 0.0, 1)
    board.until(lambda board: not board.vibrates())


@pytest.mark.parametrize("argument", ["/dev/nothing-here", "{port}?pin=4"])
def test_what_cannot_be_opened_is_one_sentence(board, argument):
    with pytest.raises(BadInput, match=r"cannot be opened|pin 4 has no PWM"):
        WatchedDevice(FIRMATA, argument.format(port=board.link))


@pytest.mark.parametrize("ending", ["SIGKILL", "SIGSTOP", "SIGINT", "SIGTERM"])
def test_a_run_that_dies_or_hangs_leaves_no_vibration(board, ending):
    program = RUN.format(path=FIRMATA, argument=str(board.link), then="signal.pause()")
    with subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.DEVNULL) as run:
        board.until(lambda board: board.vibrates())
        os.kill(run.pid, getattr(signal, ending))
        board.until(lambda board: not board.vibrates())
        run.kill()


def test_it_stills_its_device_when_it_is_ended_itself(board, device):
    device.set(1.0, 80.0, 1)
    device._process.send_signal(signal.SIGINT)  # as Ctrl-C would, if it were in the terminal's group
    device.set(1.0, 80.0, 1)
    device._process.terminate()
    device._process.wait(10)
    assert not board.vibrates()
