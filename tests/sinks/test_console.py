import io
import threading

from helpers import MS, make_step

from haptigraph.messages import Capture, Fault
from haptigraph.sinks.console import MOST_WAITING, ConsoleSink


def test_changes_and_new_faults_are_told_once():
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


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_a_run_at_full_speed_shows_its_time_in_a_terminal():
    terminal = Terminal()
    sink = ConsoleSink(terminal, shows_time=True)
    for ms in range(0, 3000, 500):
        sink.write(Capture(0, ms * MS, None), make_step(stamp_ns=ms * MS))
    sink.close()
    assert [f"{second}.00 s  ..." in terminal.getvalue() for second in (1, 2, 3)] == [True, True, False]
    assert terminal.getvalue().endswith("\r\033[K")


def test_no_time_is_shown_where_nobody_looks():
    stream = io.StringIO()
    sink = ConsoleSink(stream, shows_time=True)
    for ms in range(0, 3000, 500):
        sink.write(Capture(0, ms * MS, None), make_step(stamp_ns=ms * MS))
    sink.close()
    assert "..." not in stream.getvalue()


class Gone(io.StringIO):
    """A terminal that goes away after its first line."""

    lines = 0

    def isatty(self) -> bool:
        return True

    def write(self, text):
        self.lines += 1
        if self.lines > 1:
            raise OSError(5, "Input/output error")
        return super().write(text)


def test_a_terminal_that_goes_away_is_told_no_more():
    terminal = Gone()
    sink = ConsoleSink(terminal, shows_time=True)
    for ms, state in ((0, "a"), (1000, "b"), (2000, "c")):
        sink.write(Capture(0, ms * MS, None), make_step(stamp_ns=ms * MS, state=state))
    sink.close()
    assert terminal.lines == 2


class Stopped(io.StringIO):
    """A terminal that is stopped with Ctrl-S."""

    def __init__(self):
        super().__init__()
        self.goes_on = threading.Event()

    def write(self, text):
        self.goes_on.wait()
        return super().write(text)


def test_a_stopped_terminal_stops_nothing_and_what_is_lost_is_counted(monkeypatch):
    monkeypatch.setattr("haptigraph.sinks.console.LAST_WORDS_S", 0.0)
    terminal, lines = Stopped(), MOST_WAITING + 10
    sink = ConsoleSink(terminal)
    for number in range(lines):
        sink.write(Capture(number, number * MS, None), make_step(stamp_ns=number * MS, state=str(number)))
    sink.close()  # nor does the end wait for it
    assert sink.dropped in (9, 10)  # the first text is already being written, or not yet
    monkeypatch.setattr("haptigraph.sinks.console.LAST_WORDS_S", 30.0)
    terminal.goes_on.set()
    sink.close()
    assert len(terminal.getvalue().splitlines()) == lines - sink.dropped


def test_no_terminal_at_all_is_no_mistake(monkeypatch):
    monkeypatch.setattr("sys.stderr", None)
    sink = ConsoleSink(shows_time=True)
    sink.write(Capture(0, 0, None), make_step())
    sink.close()
