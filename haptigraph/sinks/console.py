"""Print a line to the terminal whenever the state changes, and when a fault occurs or ends.

A thread does the writing: a stopped terminal (Ctrl-S) or an unread pipe must not stop the loop.
"""

import sys
from queue import SimpleQueue
from threading import Thread
from typing import TextIO

from haptigraph.messages import Capture, Fault, Step, reason
from haptigraph.sinks.stale_images import StaleImages, is_stale

__all__ = ["ConsoleSink"]

MAX_QUEUED = 1000  # texts
FLUSH_TIMEOUT_S = 1.0  # to write the queue at the end of the run


class ConsoleSink:
    """Print state changes, new faults and their ends; of stale images that are frequent, only how many.

    Args:
        stream: Output; standard error if None.
        shows_time: Whether to show the run's time in a terminal, updated every second; for runs faster than
            real time.
    """

    def __init__(self, stream: TextIO | None = None, *, shows_time: bool = False) -> None:
        self._stream: TextIO | None = stream or sys.stderr
        """None if there is no terminal, or it was closed."""
        self._clear = "\r\033[K" if self._stream is not None and self._stream.isatty() else ""
        self._shows_time = shows_time and bool(self._clear)
        self._second = 0
        self._start_ns: int | None = None
        self._state = ""
        self._faults: tuple[Fault, ...] = ()
        self._stale = StaleImages()
        self._time_s = 0.0
        self.dropped = 0
        """Texts that were not written because the queue was full."""
        self._queue: SimpleQueue[str | None] = SimpleQueue()
        self._thread = Thread(target=self._write_all, name="haptigraph-console", daemon=True)
        self._thread.start()

    def write(self, capture: Capture, step: Step) -> None:
        """Print the changes in one step."""
        self._start_ns = step.stamp_ns if self._start_ns is None else self._start_ns
        time_s = (step.stamp_ns - self._start_ns) / 1e9
        self._time_s = time_s
        for line in self._stale.add(step):
            self.print_line(f"{time_s:7.2f} s  ! {line}")
        hides = self._stale.is_hidden
        faults = tuple(fault for fault in step.observation.faults if not (hides and is_stale(fault)))
        for fault in faults:
            if fault.is_over or fault not in self._faults:
                self.print_line(f"{time_s:7.2f} s  {'' if fault.is_over else '! '}{fault}")
        self._faults = faults
        if step.conclusion.state != self._state and not hides:
            self._state = step.conclusion.state
            forces = ", ".join(step.conclusion.forces)
            exerts = f"; force: {forces}" if forces else ""
            self.print_line(f"{time_s:7.2f} s  {self._state:34} {reason(capture, step)}{exerts}")
        if self._shows_time and int(time_s) != self._second:
            self._second = int(time_s)
            self._put(f"{self._clear}{time_s:7.2f} s  ...")

    def take_faults(self) -> tuple[Fault, ...]:
        """Return no faults: printing never fails."""
        return ()

    def close(self) -> None:
        """Write what is left, if the terminal still accepts it."""
        for line in self._stale.counted():
            self.print_line(f"{self._time_s:7.2f} s  ! {line}")
        if self._shows_time:
            self._put(self._clear)
        self._queue.put(None)
        self._thread.join(FLUSH_TIMEOUT_S)

    def print_line(self, line: str) -> None:
        """Print a line behind those of the steps so far."""
        self._put(f"{self._clear}{line}\n")

    def _put(self, text: str) -> None:
        if self._queue.qsize() < MAX_QUEUED:
            self._queue.put(text)
        else:
            self.dropped += 1

    def _write_all(self) -> None:
        """Write the queue; after an error write nothing more: a closed terminal must not end a run."""
        while (text := self._queue.get()) is not None:
            if self._stream is None:
                continue
            try:
                self._stream.write(text)
                self._stream.flush()
            except (OSError, ValueError):  # disconnected, or closed
                self._stream = None
