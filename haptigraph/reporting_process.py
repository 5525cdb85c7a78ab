"""A process of ours that takes messages and sends reports through its pipes; nothing here waits for it."""

import os
import subprocess
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import IO, Generic, TypeVar

import msgspec
from msgspec import Struct

from haptigraph.child_process import pipe_of, start_child
from haptigraph.pipes import READ_SIZE, Frames, framed

__all__ = ["ReportingProcess"]

T = TypeVar("T")


class ReportingProcess(Generic[T]):
    """Start the process; a thread listens to it.

    Args:
        command: The program and its arguments.
        kind: Of its reports.
        changed: Notified, and held, whenever reports arrive or the process ends.
        hear: Called with the reports that arrive.
        name: Of the thread.

    Raises:
        OSError: If it cannot be started.
    """

    def __init__(
        self,
        command: Sequence[str],
        kind: type[T],
        changed: threading.Condition,
        hear: Callable[[list[T]], None],
        name: str,
    ) -> None:
        self.has_ended = False
        """Whether no report will come any more."""
        self._kind, self._changed, self._hear = kind, changed, hear
        self._process = start_child(command)
        self._input, output = pipe_of(self._process.stdin), pipe_of(self._process.stdout)
        os.set_blocking(self._input.fileno(), False)
        threading.Thread(target=self._listen, args=(output,), name=name, daemon=True).start()

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    @property
    def is_running(self) -> bool:
        """Whether it has not exited."""
        return self._process.poll() is None

    def send(self, message: Struct) -> None:
        """Send a message whole or not at all: it is shorter than what a pipe takes in one piece."""
        self.write(framed(message))

    def write(self, data: bytes) -> None:
        """Write to its input; lost if it does not read."""
        with suppress(OSError, ValueError):  # hung, ended, or closed, which is noticed elsewhere
            os.write(self._input.fileno(), data)

    def end(self, within_s: float) -> int | None:
        """Let it end; return its exit code; None if it does not end."""
        self._close_input()
        try:
            return self._process.wait(within_s)
        except subprocess.TimeoutExpired:
            return None

    def kill(self) -> None:
        """End it at once, if it has not ended: then nobody knows in what state it leaves its hardware."""
        self._process.kill()
        self._process.wait()
        self._close_input()

    def _close_input(self) -> None:
        with suppress(OSError):
            self._input.close()

    def _listen(self, output: IO[bytes]) -> None:
        frames = Frames()
        with output, suppress(OSError, msgspec.MsgspecError):
            while data := os.read(output.fileno(), READ_SIZE):
                reports = frames.add(data, self._kind)
                with self._changed:
                    self._hear(reports)
                    self._changed.notify_all()
        with self._changed:
            self.has_ended = True
            self._changed.notify_all()
