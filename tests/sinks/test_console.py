import io
import threading

import numpy as np
from helpers import MS, make_step
from msgspec.structs import replace

from haptigraph.messages import STALE_IMAGE, Capture, Fault
from haptigraph.sinks.console import MAX_QUEUED, ConsoleSink
from haptigraph.sinks.stale_images import FREQUENT_STALE


def test_changes_and_new_faults_are_printed_once():
    stream = io.StringIO()
    sink = ConsoleSink(stream)
    fault = Fault("source", "camera:0 is gone")
    for ms, state, faults in ((0, "a", ()), (33, "a", ()), (66, "b", (fault,)), (99, "b", (fault,))):
        sink.write(Capture(0, ms * MS, None), make_step(stamp_ns=ms * MS, state=state, faults=faults))
    sink.close()
    assert stream.getvalue().splitlines() == [
        "   0.00 s  a                                  because",
        "   0.07 s  ! source: camera:0 is gone",
        "   0.07 s  b                                  because",
    ]
    assert sink.take_faults() == ()


def test_the_end_of_a_fault_is_printed():
    stream = io.StringIO()
    sink = ConsoleSink(stream)
    lost, back = Fault("device", "unplugged"), Fault("device", "responds again", is_over=True)
    for ms, faults in ((0, (lost,)), (33, ()), (66, (back, lost)), (99, (back,))):
        sink.write(Capture(0, ms * MS, None), make_step(stamp_ns=ms * MS, faults=faults))
    sink.close()
    assert stream.getvalue().splitlines() == [
        "   0.00 s  ! device: unplugged",
        "   0.00 s  some_state                         because",
        "   0.07 s  device: responds again",
        "   0.07 s  ! device: unplugged",
        "   0.10 s  device: responds again",
    ]


def test_the_forces_of_a_state_are_named():
    stream, step = io.StringIO(), make_step(state="a")
    sink = ConsoleSink(stream)
    conclusion = replace(step.conclusion, forces=("guide", "floor"))
    sink.write(Capture(0, 0, None), replace(step, conclusion=conclusion))
    sink.close()
    assert stream.getvalue().strip().endswith("because; force: guide, floor")


def test_a_state_without_image_says_that_there_is_none():
    stream = io.StringIO()
    sink = ConsoleSink(stream)
    image, lost = np.zeros((2, 2), np.uint8), (Fault("source", "camera:0 is gone"),)
    for ms, shown, state, faults in (
        (0, image, "unknown", ()),
        (33, image, "a", ()),
        (66, None, "unknown", lost),
        (99, image, "a", ()),
        (132, None, "unknown", ()),
    ):
        sink.write(Capture(0, ms * MS, shown), make_step(stamp_ns=ms * MS, state=state, faults=faults))
    sink.close()
    unknown = [line for line in stream.getvalue().splitlines() if "unknown" in line]
    assert [line.split("unknown")[1].strip() for line in unknown] == [
        "because",
        "there is no new image",
        "the images have ended",
    ]


def printed(shown: str) -> list[str]:
    """What a run prints, one letter a 100 ms: a state, or "-" for a stale image."""
    stream = io.StringIO()
    sink = ConsoleSink(stream)
    stale = Fault("source", f"{STALE_IMAGE}: none for 100 ms")
    for number, letter in enumerate(shown):
        state, faults = ("unknown", (stale,)) if letter == "-" else (letter, ())
        stamp_ns = number * 100 * MS
        sink.write(Capture(0, stamp_ns, None), make_step(stamp_ns=stamp_ns, state=state, faults=faults))
    sink.close()
    lines = stream.getvalue().splitlines()
    return [line.removesuffix("because").removesuffix("there is no new image").strip() for line in lines]


PAIR = [
    "{:.2f} s  ! source: stale image: none for 100 ms",
    "{:.2f} s  unknown",
    "{:.2f} s  a",
]


def pair(at_s: float) -> list[str]:
    """The lines of a stale image, and of the state after it."""
    times_s = (at_s, at_s, at_s + 0.1)
    return [line.format(time_s) for line, time_s in zip(PAIR, times_s, strict=True)]


def test_of_frequent_stale_images_only_the_number_is_printed():
    shown = "a" + 3 * "-a" + 20 * "--a" + "b" + 40 * "-b"
    lines = printed(shown)
    assert lines[:10] == ["0.00 s  a", *pair(0.1), *pair(0.3), *pair(0.5)]
    assert lines[10] == f"0.70 s  ! {FREQUENT_STALE}"
    assert lines[11:] == [
        "6.70 s  b",
        "10.70 s  ! 40 x source: stale image",
        "14.70 s  ! 20 x source: stale image",
    ]


def test_a_long_loss_is_printed_even_where_stale_images_are_frequent():
    lines = printed("a" + 5 * "-a" + 30 * "-" + "a")
    assert lines[10:] == [
        f"0.70 s  ! {FREQUENT_STALE}",
        "2.10 s  ! source: stale image: none for 100 ms",
        "2.10 s  unknown",
        "4.10 s  a",
        "4.10 s  ! 3 x source: stale image",
    ]


def test_when_images_arrive_in_time_again_it_is_said_and_the_next_is_printed():
    lines = printed("a" + 5 * "-a" + 210 * "a" + "-a")
    assert lines[10:] == [
        f"0.70 s  ! {FREQUENT_STALE}",
        "10.70 s  ! 2 x source: stale image",
        "20.70 s  ! images arrive in time again",
        *pair(22.1),
    ]


def test_rare_stale_images_are_all_printed():
    assert len(printed(5 * (41 * "a" + "-") + "a")) == 1 + 5 * 3


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_run_faster_than_real_time_shows_its_time_in_a_terminal():
    terminal = Terminal()
    sink = ConsoleSink(terminal, shows_time=True)
    for ms in range(0, 3000, 500):
        sink.write(Capture(0, ms * MS, None), make_step(stamp_ns=ms * MS))
    sink.close()
    assert [f"{second}.00 s  ..." in terminal.getvalue() for second in (1, 2, 3)] == [True, True, False]
    assert terminal.getvalue().endswith("\r\033[K")


def test_no_time_is_shown_outside_a_terminal():
    stream = io.StringIO()
    sink = ConsoleSink(stream, shows_time=True)
    for ms in range(0, 3000, 500):
        sink.write(Capture(0, ms * MS, None), make_step(stamp_ns=ms * MS))
    sink.close()
    assert "..." not in stream.getvalue()


class Disconnected(io.StringIO):
    """A terminal that disconnects after its first line."""

    lines = 0

    def isatty(self) -> bool:
        return True

    def write(self, text):
        self.lines += 1
        if self.lines > 1:
            raise OSError(5, "Input/output error")
        return super().write(text)


def test_nothing_is_written_to_a_disconnected_terminal():
    terminal = Disconnected()
    sink = ConsoleSink(terminal, shows_time=True)
    for ms, state in ((0, "a"), (1000, "b"), (2000, "c")):
        sink.write(Capture(0, ms * MS, None), make_step(stamp_ns=ms * MS, state=state))
    sink.close()
    assert terminal.lines == 2


class Stopped(io.StringIO):
    """A terminal that is stopped with Ctrl-S."""

    def __init__(self):
        super().__init__()
        self.resumed = threading.Event()

    def write(self, text):
        self.resumed.wait()
        return super().write(text)


def test_a_stopped_terminal_blocks_nothing_and_lost_texts_are_counted(monkeypatch):
    monkeypatch.setattr("haptigraph.sinks.console.FLUSH_TIMEOUT_S", 0.0)
    terminal, lines = Stopped(), MAX_QUEUED + 10
    sink = ConsoleSink(terminal)
    for number in range(lines):
        sink.write(Capture(number, number * MS, None), make_step(stamp_ns=number * MS, state=str(number)))
    sink.close()  # does not wait either
    assert sink.dropped in (9, 10)  # depends on whether the first text is already being written
    monkeypatch.setattr("haptigraph.sinks.console.FLUSH_TIMEOUT_S", 30.0)
    terminal.resumed.set()
    sink.close()
    assert len(terminal.getvalue().splitlines()) == lines - sink.dropped


def test_a_missing_terminal_is_no_error(monkeypatch):
    monkeypatch.setattr("sys.stderr", None)
    sink = ConsoleSink(shows_time=True)
    sink.write(Capture(0, 0, None), make_step())
    sink.close()
