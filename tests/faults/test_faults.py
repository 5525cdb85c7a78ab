"""After any fault of a real run, the actuator itself is silent in time (DESIGN, section 6)."""

import os
import random
import resource
import signal
import socket
import time
from contextlib import ExitStack
from itertools import pairwise
from pathlib import Path

import pytest
from firmata_board import Board
from helpers import mostly_slow
from real_run import Rig
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from haptigraph.recording.reader import RunReader
from haptigraph.recording.recovery import recover

pytest.importorskip("serial")
pytest.importorskip("sdl2", exc_type=ImportError)
FULL_BYTES = 400_000
REPLACED_MS = 1000
BUSY_MS = 100  # such a latency may delay the responses of a board as well


@pytest.fixture
def rig(request, tmp_path):
    with Rig(tmp_path, getattr(request, "param", "serial")) as rig:
        rig.until_vibrating()
        yield rig


def end(rig, *, code=0, whole=True):
    """Check that the run ends as promised and leaves a readable recording; return its output."""
    ended, out, err = rig.finish()
    assert (ended, "Traceback" in err) == (code, False), err
    reader = RunReader(rig.record)
    assert reader.is_whole is whole
    assert reader.count()[0] > 0
    return out + err


def await_commands(rig, count):
    """Wait until the board has received a number of further commands."""
    board = rig.monitor.board
    with board.changed:
        target = board.commands + count
        assert board.changed.wait_for(lambda: board.commands >= target, 30)


@pytest.mark.parametrize("rig", mostly_slow(["serial", "gamepad", "audio"], "serial"), indirect=True)
def test_a_transient_fault_is_silenced_in_time_and_reported_and_vibration_resumes(rig):
    for fault, message in (
        ("stale image", "source: stale image: none for 100 ms"),
        ("lost camera", "source: camera:0 delivers no images; trying to get it back"),
        ("perceiver fails twice", "perceiver: ValueError: injected"),
        ("interpreter stalls", ""),
    ):
        rig.silent_in_time(fault, rig.begin(fault))
        rig.until_output(message)
        rig.begin("none")
        rig.monitor.until(vibrates=True)
    rig.silent_in_time("process stopped", rig.signal(signal.SIGSTOP))
    rig.signal(signal.SIGCONT)  # for the process, the clock has jumped
    rig.monitor.until(vibrates=True)
    rig.silent_in_time("SIGINT", rig.signal(signal.SIGINT))
    assert "interrupted" in end(rig)


@pytest.mark.parametrize(
    ("rig", "ending"),
    [
        ("gamepad", "SIGTERM"),
        *(pytest.param("serial", name, marks=pytest.mark.slow) for name in ("SIGTERM", "SIGHUP")),
    ],
    indirect=["rig"],
)
def test_signals_silence_the_device_at_once(rig, ending):
    rig.silent_in_time(ending, rig.signal(getattr(signal, ending)))
    assert "interrupted" in end(rig)


@pytest.mark.parametrize("rig", ["serial", "gamepad"], indirect=True)
def test_a_killed_run_is_silent_and_its_recording_readable(rig):
    rig.until_recorded()
    rig.silent_in_time("SIGKILL", rig.signal(signal.SIGKILL))
    end(rig, code=-signal.SIGKILL, whole=False)
    assert recover(rig.record).saved == rig.record
    assert RunReader(rig.record).is_whole


def test_a_killed_run_provides_no_more_samples_to_the_sound_card(tmp_path):
    with Rig(tmp_path, "audio") as rig:
        rig.until_vibrating()
        rig.until_recorded()
        rig.signal(signal.SIGKILL)
        end(rig, code=-signal.SIGKILL, whole=False)  # the process that fills the buffers is gone


@pytest.mark.parametrize("rig", mostly_slow(["serial", "audio"], "audio"), indirect=True)
def test_three_failures_of_the_perceiver_end_the_run_with_one_sentence(rig):
    rig.silent_in_time("perceiver fails", rig.begin("perceiver fails"))
    assert "haptigraph: perception failed on 3 images in a row: ValueError: injected" in end(rig, code=2)


def test_a_stalled_loop_is_silent_and_can_be_terminated(rig):
    rig.silent_in_time("perceiver stalls", rig.begin("perceiver stalls"))
    rig.signal(signal.SIGTERM)
    assert "interrupted" in end(rig)


def test_the_end_of_the_source_silences_the_device_and_ends_the_run(rig):
    rig.silent_in_time("source ends", rig.begin("source ends"))
    assert "source ended" in end(rig)


def test_a_lost_board_is_reported_once_and_vibrates_again_when_it_is_back(rig):
    board = rig.monitor.board
    for fail, recover_board, message in (
        (board.unplug, board.plug, r"! device: .*\n"),
        (
            lambda: setattr(board, "responds", False),
            lambda: setattr(board, "responds", True),
            "does not respond",
        ),
    ):
        rig.begin("none")
        began_ns = time.monotonic_ns()
        fail()
        rig.silent_in_time("board unplugged" if fail == board.unplug else "board does not respond", began_ns)
        rig.until_output(message)
        recover_board()
        board.until(Board.is_recovered)
        reports = "".join(rig.lines).count("! device:")
        assert reports == 1 or rig.probe.late_ms(began_ns, time.monotonic_ns()) > BUSY_MS, rig.lines
    board.reset()
    rig.monitor.until(vibrates=True)
    rig.signal(signal.SIGINT)
    end(rig)


@pytest.mark.parametrize("rig", mostly_slow(["serial", "gamepad"], "gamepad"), indirect=True)
def test_a_watchdog_process_that_hangs_is_replaced_and_vibration_resumes(rig):
    began_ns = time.monotonic_ns()
    os.kill(rig.watchdog(), signal.SIGSTOP)
    silent_ns = rig.monitor.until_silent_once(began_ns)
    rig.in_time("watchdog hangs", began_ns, silent_ns, REPLACED_MS)
    rig.until_output("! device: ")
    rig.monitor.until(vibrates=True)
    rig.signal(signal.SIGINT)
    end(rig)


@pytest.mark.parametrize("rig", mostly_slow(["serial", "gamepad"], "serial"), indirect=True)
def test_a_watchdog_process_that_hangs_at_the_end_leaves_no_vibration(rig):
    watchdog = rig.watchdog()
    began_ns = time.monotonic_ns()
    os.kill(watchdog, signal.SIGSTOP)
    rig.signal(signal.SIGINT)
    output = end(rig)
    rig.in_time("watchdog hangs, SIGINT", began_ns, rig.monitor.until(vibrates=False), REPLACED_MS)
    assert "may still vibrate" not in output
    assert not Path(f"/proc/{watchdog}").exists()


def test_an_end_without_confirmed_silence_is_said_last_and_in_the_exit_code(rig):
    rig.monitor.board.responds = False
    rig.signal(signal.SIGINT)
    output = end(rig, code=2)
    assert output.splitlines()[-1] == (
        f"haptigraph: serial:{rig.monitor.board.link} does not confirm silence; "
        "it may still vibrate: switch it off"
    )


def test_vibration_resumes_after_the_watchdog_process_is_killed(rig):
    """Nothing can silence the board until the process in reserve has opened it.

    It silences the board before it executes commands; the next command may be pending already.
    """
    watchdog = rig.watchdog()
    began_ns = time.monotonic_ns()
    os.kill(watchdog, signal.SIGKILL)
    rig.in_time("watchdog killed", began_ns, rig.monitor.until_silent_once(began_ns), REPLACED_MS)
    rig.monitor.until(vibrates=True)
    rig.signal(signal.SIGINT)
    end(rig)


def is_steady(rig):
    """Return whether the device vibrated most of the time since it first did, apart from gaps of a busy machine.

    A stall that only the run met is not in the probe's log: it is outweighed by a longer observation.
    """
    give_up_ns = time.monotonic_ns() + 10 * 10**9
    while not vibrated_mostly(rig):
        if time.monotonic_ns() > give_up_ns:
            return False
        rig.probe.is_stopped.wait(0.1)
    return True


def vibrated_mostly(rig):
    edges = [*rig.monitor.edges, (time.monotonic_ns(), 0)]
    first = next(number for number, (_, level) in enumerate(edges) if level)
    on_ns = sum(after - before for (before, level), (after, _) in pairwise(edges[first:]) if level)
    late_ns = 1e6 * rig.probe.late_ms(edges[first][0], edges[-1][0])
    return on_ns + late_ns > 0.6 * (edges[-1][0] - edges[first][0])


def test_a_full_disk_is_reported_and_control_continues(tmp_path):
    """A limit of the file size has the effect of a full disk."""

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (FULL_BYTES, FULL_BYTES))

    with Rig(tmp_path, "serial", preexec_fn=limit) as rig:
        rig.until_output(r"recorder: .*run\.mcap is incomplete \(File too large\); later steps are lost, ")
        await_commands(rig, 10)
        assert is_steady(rig)
        rig.silent_in_time("full disk, then SIGINT", rig.signal(signal.SIGINT))
        end(rig, code=2, whole=False)
        assert recover(rig.record).saved == rig.record


def test_a_jump_of_the_wall_clock_and_a_slow_disk_do_not_interrupt_vibration(rig):
    for fault, count in (("wall clock jumps", 10), ("slow disk", 30), ("none", 5)):
        rig.begin(fault)
        await_commands(rig, count)
        assert is_steady(rig), fault
    rig.silent_in_time("wall clock jumped, disk was slow, SIGINT", rig.signal(signal.SIGINT))
    assert " 0 not recorded" not in end(rig)  # images were lost, and counted


def test_invalid_network_messages_have_no_effect(tmp_path):
    rng = random.Random(5)
    with Rig(tmp_path, "serial", "--recordings", str(tmp_path), command="live") as rig:
        address = rig.until_output(r"the page is at http://(\S+?)/")[1]
        rig.until_vibrating()
        for _ in range(3):
            try:
                with connect(f"ws://{address}/live", origin=f"http://{address}", close_timeout=0.1) as line:
                    for _ in range(100):
                        line.send(rng.choice(INVALID))
            except ConnectionClosed:
                pass  # the server may close such connections
        host, port = address.split(":")
        for text in (
            b"\x00" * 5000,
            b"GET /live HTTP/1.1\r\nUpgrade: websocket\r\n\r\n",
            b"GET " + b"/" * 9000,
        ):
            with socket.create_connection((host, int(port)), timeout=10) as line:
                line.sendall(text)
        await_commands(rig, 10)
        assert is_steady(rig)
        rig.silent_in_time("invalid network messages, then SIGTERM", rig.signal(signal.SIGTERM))
        end(rig)


INVALID = [
    "", "{", "null", "[]", "7", '"x"', "{}" * 500, '{"type": 3}', '{"type": "hand"}', '{"type": "steer", "along": NaN}',
    '{"type": "hand", "along_mm": 1e999}', "[" * 20_000, '{"type": "' + "x" * 50_000 + '"}', b"\xff" * 100, b"", "\ud7ff",
]  # fmt: skip


def test_half_open_connections_do_not_keep_the_watchdog_from_restarting(tmp_path):
    def limit():
        resource.setrlimit(resource.RLIMIT_NOFILE, (1024, 1024))

    with Rig(tmp_path, "serial", "--recordings", str(tmp_path), command="live", preexec_fn=limit) as rig:
        host, port = rig.until_output(r"the page is at http://(\S+?)/")[1].split(":")
        rig.until_vibrating()
        with ExitStack() as stack:
            for _ in range(1024):
                line = stack.enter_context(socket.create_connection((host, int(port)), timeout=10))
                line.sendall(b"GET / HTTP/1.1\r\nHost: 127.0")
            began_ns = time.monotonic_ns()
            os.kill(rig.watchdog(), signal.SIGKILL)
            silent_ns = rig.monitor.until_silent_once(began_ns)
            rig.in_time("half-open connections, watchdog killed", began_ns, silent_ns, REPLACED_MS)
            rig.monitor.until(vibrates=True)
        rig.silent_in_time("half-open connections, then SIGTERM", rig.signal(signal.SIGTERM))
        assert len(end(rig)) < 10_000
