import io
import threading

from helpers import MS, make_step
from msgspec.structs import replace

from haptigraph.messages import Capture, Fault
from haptigraph.sinks.console import MAX_QUEUED, ConsoleSink


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
