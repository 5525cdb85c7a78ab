"""The watchdog process silences its device when the run dies, hangs or closes."""

import os
import resource
import signal
import subprocess
import sys
from contextlib import suppress

import pytest
from firmata_board import Board
from helpers import mostly_slow

from haptigraph.errors import BadInput, DeviceError
from haptigraph.haptics.watchdog import HOLDS_MS, WatchedDevice
from haptigraph.haptics.watchdog_process import Reply

pytest.importorskip("serial")
FIRMATA = "haptigraph.haptics.boards.pwm:PwmDevice"
RUN = """
import signal
from haptigraph.haptics.watchdog import WatchedDevice
device = WatchedDevice({path!r}, {argument!r}, "serial")
device.set(1.0, 80.0, 0)
{then}
"""


@pytest.fixture
def board(tmp_path):
    with Board(tmp_path / "tty") as board:
        yield board


@pytest.fixture
def device(board):
    device = WatchedDevice(FIRMATA, str(board.link), "serial")
    yield device
    device.close()


def test_it_forwards_commands_and_capabilities(board, device):
    assert device.capabilities.amplitude_levels == 255
    assert device.capabilities.holds_ms == HOLDS_MS
    device.set(0.3, 80.0, 1)
    assert board.values[9] == 76
    device.set(0.0, 0.0, 2)
    assert not board.vibrates()


def test_it_silences_a_device_without_further_commands(board, device):
    device.set(1.0, 80.0, 1)
    set_ns = board.edges[-1][0]
    silent_ns = board.until(lambda board: not board.vibrates())
    assert silent_ns - set_ns >= HOLDS_MS * 1e6 - 1e6
    device.set(1.0, 80.0, 1)  # and resumes with the next command
    assert board.vibrates()


def test_it_forwards_errors(board, device):
    board.unplug()
    with pytest.raises(DeviceError, match=r"cannot be opened|is lost"):
        device.set(1.0, 80.0, 1)
    board.plug()
    device.set(1.0, 80.0, 1)
    assert board.vibrates()


def test_it_is_restarted_if_it_is_killed(board, device):
    device.set(1.0, 80.0, 1)
    device._active.process.kill()
    device._active.process.wait()
    with suppress(DeviceError):  # it has not started yet
        device.set(0.0, 0.0, 1)
    board.until(lambda board: not board.vibrates())


def hang(device):
    """Stop the watchdog process while it vibrates; return its number."""
    device.set(1.0, 80.0, 1)
    device._active.process.send_signal(signal.SIGSTOP)
    return device._active.process.pid


def is_running(pid):
    with suppress(ProcessLookupError):
        os.kill(pid, 0)
        return True
    return False


def test_it_is_replaced_if_it_hangs(board, device):
    hung = hang(device)
    with pytest.raises(DeviceError, match="did not answer, and was replaced"):
        device.set(1.0, 80.0, 2)
    board.until(lambda board: not board.vibrates())
    assert not is_running(hung)
    while not board.vibrates():
        with suppress(DeviceError):  # it has not started yet
            device.set(1.0, 80.0, 3)


def test_it_is_replaced_if_it_hangs_after_its_acknowledgement(board, device, monkeypatch):
    hang(device)
    acknowledged = Reply(device._number + 1, is_executed=False)
    device._active.replies.put(acknowledged)
    with pytest.raises(DeviceError, match="did not answer, and was replaced"):
        device.set(1.0, 80.0, 2)
    board.until(lambda board: not board.vibrates())


def test_a_reserve_opens_the_device_and_another_is_started(board, device):
    for _ in range(3):
        reserve = device._reserve.process
        device._active.process.kill()
        device._active.process.wait()
        while not board.vibrates():
            with suppress(DeviceError):  # it opens the device
                device.set(1.0, 80.0, 1)
        assert device._active.process is reserve
        assert device._reserve.process.poll() is None
        device.set(0.0, 0.0, 2)


def test_a_reserve_that_died_is_replaced_too(board, device):
    device._reserve.process.kill()
    device._reserve.process.wait()
    device._active.process.kill()
    device._active.process.wait()
    while not board.vibrates():
        with suppress(DeviceError):
            device.set(1.0, 80.0, 1)


def test_closing_silences_a_device_although_the_reserve_died(board, device):
    hang(device)
    device._reserve.process.kill()
    device._reserve.process.wait()
    device.close()
    assert not board.vibrates()


def test_closing_ends_both_processes(board):
    device = WatchedDevice(FIRMATA, str(board.link), "serial")
    reserve = device._reserve.process
    device.close()
    assert device._active.process.poll() == 0
    assert reserve.poll() is not None


def test_a_process_that_acknowledges_is_not_replaced(board, device):
    board.responds = False  # so the board, not the process, is to blame
    process = device._active.process
    for stamp_ns in range(3):
        with pytest.raises(DeviceError, match=r"does not respond|nothing on"):
            device.set(1.0, 80.0, stamp_ns)
    assert device._active.process is process
    board.responds = True


@pytest.mark.parametrize("end", [hang, lambda device: device._active.process.kill()], ids=["hung", "killed"])
def test_closing_silences_a_device_whose_process_does_not(board, device, end):
    device.set(1.0, 80.0, 1)
    end(device)
    pid = device._active.process.pid
    device.close()
    assert not board.vibrates()
    assert not is_running(pid)
    assert device._active.process.poll() == 0


@pytest.mark.parametrize("end", [hang, lambda device: None], ids=["hung", "alive"])
def test_closing_a_device_that_does_not_confirm_silence_is_an_error(board, end):
    device = WatchedDevice(FIRMATA, str(board.link), "serial")
    device.set(1.0, 80.0, 1)
    end(device)
    board.unplug()
    with pytest.raises(DeviceError, match="does not confirm silence"):
        device.close()
    device.close()  # the second call has nothing left to do


def test_it_is_restarted_although_all_descriptors_are_used_up(board, device):
    device.set(1.0, 80.0, 1)
    limits, taken = resource.getrlimit(resource.RLIMIT_NOFILE), []
    resource.setrlimit(resource.RLIMIT_NOFILE, (256, limits[1]))
    try:
        with suppress(OSError):
            while True:
                taken.append(os.open(os.devnull, os.O_RDONLY))
        device._active.process.kill()
        device._active.process.wait()
        with suppress(DeviceError):  # it has not started yet
            device.set(0.0, 0.0, 1)
        board.until(lambda board: not board.vibrates())
    finally:
        for descriptor in taken:
            os.close(descriptor)
        resource.setrlimit(resource.RLIMIT_NOFILE, limits)


@pytest.mark.parametrize("argument", ["/dev/nothing-here", "{port}?pin=4"])
def test_a_device_that_cannot_be_opened_is_one_sentence(board, argument):
    with pytest.raises(BadInput, match=r"cannot be opened|pin 4 does not support PWM"):
        WatchedDevice(FIRMATA, argument.format(port=board.link), "serial")


@pytest.mark.parametrize(
    "ending", mostly_slow(["SIGKILL", "SIGSTOP", "SIGINT", "SIGTERM"], "SIGKILL", "SIGSTOP")
)
def test_a_run_that_dies_or_hangs_leaves_no_vibration(board, ending):
    program = RUN.format(path=FIRMATA, argument=str(board.link), then="signal.pause()")
    with subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.DEVNULL) as run:
        board.until(lambda board: board.vibrates())
        os.kill(run.pid, getattr(signal, ending))
        board.until(lambda board: not board.vibrates())
        run.kill()


def test_it_silences_its_device_when_it_is_terminated(board, device):
    device.set(1.0, 80.0, 1)
    device._active.process.send_signal(
        signal.SIGINT
    )  # as Ctrl-C would, if it were in the process group of the terminal
    device.set(1.0, 80.0, 1)
    device._active.process.terminate()
    device._active.process.wait(10)
    assert not board.vibrates()
