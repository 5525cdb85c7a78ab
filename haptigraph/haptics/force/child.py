"""One process that runs the loop of a force device; it opens the device on command."""

import os
import subprocess
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import IO

import msgspec

from haptigraph.child_process import pipe_of, program_of, start_child
from haptigraph.haptics.force.interface import ForceCapabilities
from haptigraph.haptics.force.messages import ForceInput, ForceReport
from haptigraph.pipes import Frames, framed

__all__ = ["Child"]

PROGRAM = program_of("haptigraph.haptics.force.loop")
READ_SIZE = 1 << 16


class Child:
    """Start the process.

    Args:
        arguments: Of the program.
        changed: Notified, and held, whenever a report arrives or the process ends.
        hear: Called with every report.

    Raises:
        OSError: If it cannot be started.
    """

    def __init__(
        self, arguments: Sequence[str], changed: threading.Condition, hear: Callable[[ForceReport], None]
    ) -> None:
        self.capabilities: ForceCapabilities | None = None
        """Of the device; None: it is not open."""
        self.error = ""
        """Why the device cannot be opened, or failed."""
        self.has_ended = False
        self._process = start_child([*PROGRAM, *arguments])
        self._input, output = pipe_of(self._process.stdin), pipe_of(self._process.stdout)
        os.set_blocking(self._input.fileno(), False)
        self._changed, self._hear = changed, hear
        threading.Thread(target=self._listen, args=(output,), name="haptigraph-force", daemon=True).start()

    def go(self) -> None:
        """Let it open the device."""
        self._write(b"g")

    def send(self, message: ForceInput) -> None:
        """Send a message whole or not at all: it is shorter than what a pipe takes in one piece."""
        self._write(framed(message))

    def end(self, within_s: float) -> int | None:
        """Let it end; return its exit code, 0 if the device let go; None if it does not end."""
        self._close_input()
        try:
            return self._process.wait(within_s)
        except subprocess.TimeoutExpired:
            return None

    def kill(self) -> None:
        """End it at once, if it has not ended: then nobody knows whether the device lets go."""
        self._process.kill()
        self._process.wait()
        self._close_input()

    def _close_input(self) -> None:
        with suppress(OSError):
            self._input.close()

    def _write(self, data: bytes) -> None:
        with suppress(OSError, ValueError):  # hung, ended, or closed, which is noticed elsewhere
            os.write(self._input.fileno(), data)

    def _listen(self, output: IO[bytes]) -> None:
        frames = Frames()
        with output, suppress(OSError, msgspec.MsgspecError):
            while data := os.read(output.fileno(), READ_SIZE):
                reports = frames.add(data, ForceReport)
                with self._changed:
                    for report in reports:
                        self._take(report)
                    self._changed.notify_all()
        with self._changed:
            self.has_ended = True
            self._changed.notify_all()

    def _take(self, report: ForceReport) -> None:
        self.capabilities = report.capabilities or self.capabilities
        self.error = report.error or self.error
        self._hear(report)
