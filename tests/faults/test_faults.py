"""Whatever goes wrong in a real run, the actuator is silent in time at its own end (DESIGN, section 6)."""

import os
import random
import resource
import signal
import socket
import time
from itertools import pairwise
from pathlib import Path

import pytest
from firmata_board import Board
from rig import Rig
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import recover

pytest.importorskip("serial")
pytest.importorskip("sdl2", exc_type=ImportError)
pytestmark = pytest.mark.xdist_group("faults")

FULL_BYTES = 400_000
BUSY_MS = 100  # a machine so late may well keep a board's answers back as well


@pytest.fixture
def rig(request, tmp_path):
    with Rig(tmp_path, getattr(request, "param", "serial")) as rig:
        rig.until_felt()
        yield rig


def end(rig, *, code=0, whole=True):
    """Check that it ends as promised and leaves a readable recording; return what it said."""
    ended, out, err = rig.finish()
    assert (ended, "Traceback" in err) == (code, False), err
    reader = RunReader(rig.record)
    assert reader.is_whole is whole
    assert reader.count()[0] > 0
    return out + err


def orders(rig, count):
    """Wait until the board was told so many times more."""
    board = rig.ear.board
    with board.changed:
        wanted = board.orders + count
        assert board.changed.wait_for(lambda: board.orders >= wanted, 30)


@pytest.mark.parametrize("rig", ["serial", "gamepad", "audio"], indirect=True)
def test_what_passes_is_silent_in_time_and_told_and_felt_again_afterwards(rig):
    for fault, told in (
        ("stale image", "source: stale image: none for 100 ms"),
        ("lost camera", "source: camera:0 delivers no images; trying to get it back"),
        ("perceiver fails twice", "perceiver: ValueError: injected"),
        ("interpreter stalls", ""),
    ):
        rig.stilled_in_time(fault, rig.begin(fault))
        rig.until_told(told)
        rig.begin("none")
        rig.ear.until(vibrates=True)
    rig.stilled_in_time("process stopped", rig.signal(signal.SIGSTOP))
    rig.signal(signal.SIGCONT)  # for the process, the clock has jumped
    rig.ear.until(vibrates=True)
    rig.stilled_in_time("SIGINT", rig.signal(signal.SIGINT))
    assert "interrupted" in end(rig)


@pytest.mark.parametrize(
    ("rig", "ending"),
    [("serial", "SIGTERM"), ("serial", "SIGHUP"), ("gamepad", "SIGTERM")],
    indirect=["rig"],
)
def test_signals_still_the_hand_at_once(rig, ending):
    rig.stilled_in_time(ending, rig.signal(getattr(signal, ending)))
    assert "interrupted" in end(rig)


@pytest.mark.parametrize("rig", ["serial", "gamepad"], indirect=True)
def test_a_killed_run_is_silent_and_its_recording_readable(rig):
    rig.until_recorded()
    rig.stilled_in_time("SIGKILL", rig.signal(signal.SIGKILL))
    end(rig, code=-signal.SIGKILL, whole=False)
    assert recover(rig.record)
    assert RunReader(rig.record).is_whole


def test_a_killed_run_hands_no_sound_card_any_samples(tmp_path):
    with Rig(tmp_path, "audio") as rig:
        rig.until_felt()
        rig.until_recorded()
        rig.signal(signal.SIGKILL)
        end(rig, code=-signal.SIGKILL, whole=False)  # who would fill a buffer is gone


@pytest.mark.parametrize("rig", ["serial", "audio"], indirect=True)
def test_a_perceiver_that_fails_three_times_ends_the_run_with_one_sentence(rig):
    rig.stilled_in_time("perceiver fails", rig.begin("perceiver fails"))
    assert "haptigraph: perception failed on 3 images in a row: ValueError: injected" in end(rig, code=2)


def test_a_loop_that_stalls_is_silent_and_can_be_ended(rig):
    rig.stilled_in_time("perceiver stalls", rig.begin("perceiver stalls"))
    rig.signal(signal.SIGTERM)
    assert "interrupted" in end(rig)


def test_a_source_that_ends_is_silent_and_the_run_with_it(rig):
    rig.stilled_in_time("source ends", rig.begin("source ends"))
    assert "source ended" in end(rig)


def test_a_board_that_goes_away_is_told_once_and_felt_again_when_it_is_back(rig):
    board = rig.ear.board
    for leave, back, told in (
        (board.unplug, board.plug, r"! device: .*\n"),
        (
            lambda: setattr(board, "answers", False),
            lambda: setattr(board, "answers", True),
            "does not answer",
        ),
    ):
        rig.begin("none")
        began_ns = time.monotonic_ns()
        leave()
        rig.stilled_in_time("board unplugged" if leave == board.unplug else "board answers no more", began_ns)
        rig.until_told(told)
        back()
        board.until(Board.goes_on)
        told_times = "".join(rig.lines).count("! device:")
        assert told_times == 1 or rig.beat.late_ms(began_ns, time.monotonic_ns()) > BUSY_MS, rig.lines
    board.reset()
    rig.ear.until(vibrates=True)
    rig.signal(signal.SIGINT)
    end(rig)


def test_the_process_that_keeps_the_device_may_die_itself(rig):
    """Nobody can still the board meanwhile: as long as it takes to start another such process.

    That one stills the board before it obeys, and the next order may be on its way already.
    """
    children = Path(f"/proc/{rig.process.pid}/task/{rig.process.pid}").parent.glob("*/children")
    (warden,) = [int(pid) for file in children for pid in file.read_text().split()]
    began_ns = time.monotonic_ns()
    os.kill(warden, signal.SIGKILL)
    rig.in_time("warden killed", began_ns, rig.ear.until_silent_once(began_ns), 3000)
    rig.ear.until(vibrates=True)
    rig.signal(signal.SIGINT)
    end(rig)


def goes_on(rig):
    """Tell whether the hand vibrated most of the time since it first did; a busy machine may cost a beat."""
    edges = [*rig.ear.edges, (time.monotonic_ns(), 0)]
    first = next(place for place, (_, level) in enumerate(edges) if level)
    on_ns = sum(after - before for (before, level), (after, _) in pairwise(edges[first:]) if level)
    return on_ns > 0.6 * (edges[-1][0] - edges[first][0])


def test_a_full_disk_is_told_and_control_goes_on(tmp_path):
    """The file system refuses to let the file grow, as a full one does."""

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (FULL_BYTES, FULL_BYTES))

    with Rig(tmp_path, "serial", preexec_fn=limit) as rig:
        rig.until_told(r"recorder: .*run\.mcap is incomplete \(File too large\); it can be recovered")
        orders(rig, 10)
        assert goes_on(rig)
        rig.stilled_in_time("full disk, then SIGINT", rig.signal(signal.SIGINT))
        end(rig, whole=False)
        assert recover(rig.record)


def test_a_wall_clock_that_jumps_and_a_slow_disk_do_not_disturb_the_beat(rig):
    for fault, count in (("wall clock jumps", 10), ("slow disk", 30), ("none", 5)):
        rig.begin(fault)
        orders(rig, count)
        assert goes_on(rig), fault
    rig.stilled_in_time("wall clock jumped, disk was slow, SIGINT", rig.signal(signal.SIGINT))
    assert " 0 not recorded" not in end(rig)  # images were lost, and counted


def test_nonsense_from_the_network_changes_nothing(tmp_path):
    chance = random.Random(5)
    with Rig(tmp_path, "serial", "--recordings", str(tmp_path), command="live") as rig:
        address = rig.until_told(r"the page is at http://(\S+?)/")[1]
        rig.until_felt()
        for _ in range(3):
            try:
                with connect(f"ws://{address}/live", origin=f"http://{address}", close_timeout=0.1) as line:
                    for _ in range(100):
                        line.send(chance.choice(NONSENSE))
            except ConnectionClosed:
                pass  # it may hang up on such visitors
        host, port = address.split(":")
        for text in (
            b"\x00" * 5000,
            b"GET /live HTTP/1.1\r\nUpgrade: websocket\r\n\r\n",
            b"GET " + b"/" * 9000,
        ):
            with socket.create_connection((host, int(port)), timeout=10) as line:
                line.sendall(text)
        orders(rig, 10)
        assert goes_on(rig)
        rig.stilled_in_time("nonsense from the network, then SIGTERM", rig.signal(signal.SIGTERM))
        end(rig)


NONSENSE = [
    "", "{", "null", "[]", "7", '"x"', "{}" * 500, '{"type": 3}', '{"type": "hand"}', '{"type": "steer", "along": NaN}',
    '{"type": "hand", "along_mm": 1e999}', "[" * 20_000, '{"type": "' + "x" * 50_000 + '"}', b"\xff" * 100, b"", "\ud7ff",
]  # fmt: skip
