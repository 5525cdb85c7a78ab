"""Tell a run in the terminal: a line whenever the state changes or something goes wrong."""

import sys
from typing import TextIO

from haptigraph.messages import Capture, Fault, Step

__all__ = ["ConsoleSink"]


class ConsoleSink:
    """Print state changes and new faults.

    Args:
        stream: Where to print; standard error if None.
        shows_time: Whether to show in a terminal how far the run is, second by second; for runs at full
            speed, where nothing else moves.
    """

    dropped = 0

    def __init__(self, stream: TextIO | None = None, *, shows_time: bool = False) -> None:
        self._stream: TextIO | None = stream or sys.stderr
        """None where there is nobody to tell: no terminal from the start, or one that went away."""
        self._clear = "\r\033[K" if self._stream is not None and self._stream.isatty() else ""
        self._shows_time = shows_time and bool(self._clear)
        self._second = 0
        self._start_ns: int | None = None
        self._state = ""
        self._faults: tuple[Fault, ...] = ()

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
            self._write(f"{self._clear}{time_s:7.2f} s  ...")

    def take_faults(self) -> tuple[Fault, ...]:
        """Return nothing: printing does not fail."""
        return ()

    def close(self) -> None:
        """Wipe the line that shows the time."""
        if self._shows_time:
            self._write(self._clear)

    def _print(self, line: str) -> None:
        self._write(f"{self._clear}{line}\n")

    def _write(self, text: str) -> None:
        """Write, or fall silent for good: a terminal that goes away must not end a run."""
        if self._stream is None:
            return
        try:
            self._stream.write(text)
            self._stream.flush()
        except (OSError, ValueError):  # gone, or closed
            self._stream = None
