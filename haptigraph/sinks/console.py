"""Tell a run in the terminal: a line whenever the state changes or something goes wrong.

A thread of its own does the writing: a terminal that is stopped (Ctrl-S) or a pipe that nobody reads must not
stop the hand.
"""

import sys
from queue import SimpleQueue
from threading import Thread
from typing import TextIO

from haptigraph.messages import Capture, Fault, Step

__all__ = ["ConsoleSink"]

MOST_WAITING = 1000  # texts
LAST_WORDS_S = 1.0  # to write what waits when the run is over


class ConsoleSink:
    """Print state changes and new faults.

    Args:
        stream: Where to print; standard error if None.
        shows_time: Whether to show in a terminal how far the run is, second by second; for runs at full
            speed, where nothing else moves.
    """

    def __init__(self, stream: TextIO | None = None, *, shows_time: bool = False) -> None:
        self._stream: TextIO | None = stream or sys.stderr
        """None where there is nobody to tell: no terminal from the start, or one that went away."""
        self._clear = "\r\033[K" if self._stream is not None and self._stream.isatty() else ""
        self._shows_time = shows_time and bool(self._clear)
        self._second = 0
        self._start_ns: int | None = None
        self._state = ""
        self._faults: tuple[Fault, ...] = ()
        self.dropped = 0
        """Texts that were not written because those before them still waited."""
        self._waiting: SimpleQueue[str | None] = SimpleQueue()
        self._thread = Thread(target=self._write_all, name="haptigraph-console", daemon=True)
        self._thread.start()

    def write(self, capture: Capture, step: Step) -> None:
        """Print what is new in one step."""
        self._start_ns = step.stamp_ns if self._start_ns is None else self._start_ns
        time_s = (step.stamp_ns - self._start_ns) / 1e9
        for fault in step.faults:
            if fault not in self._faults:
                self._print(f"{time_s:7.2f} s  ! {fault.where}: {fault.message}")
        self._faults = step.faults
        if step.conclusion.state != self._state:
            self._state = step.conclusion.state
            self._print(f"{time_s:7.2f} s  {self._state:34} {step.conclusion.because}")
        if self._shows_time and int(time_s) != self._second:
            self._second = int(time_s)
            self._say(f"{self._clear}{time_s:7.2f} s  ...")

    def take_faults(self) -> tuple[Fault, ...]:
        """Return nothing: printing does not fail."""
        return ()

    def close(self) -> None:
        """Wipe the line that shows the time, and write what waits, if someone reads it."""
        if self._shows_time:
            self._say(self._clear)
        self._waiting.put(None)
        self._thread.join(LAST_WORDS_S)

    def _print(self, line: str) -> None:
        self._say(f"{self._clear}{line}\n")

    def _say(self, text: str) -> None:
        if self._waiting.qsize() < MOST_WAITING:
            self._waiting.put(text)
        else:
            self.dropped += 1

    def _write_all(self) -> None:
        """Write, or fall silent for good: a terminal that goes away must not end a run."""
        while (text := self._waiting.get()) is not None:
            if self._stream is None:
                continue
            try:
                self._stream.write(text)
                self._stream.flush()
            except (OSError, ValueError):  # gone, or closed
                self._stream = None
