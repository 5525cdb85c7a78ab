"""A watchdog process as the run sees it, and what goes through its pipes: commands in, replies out."""

import math
import queue
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from typing import IO

import msgspec
from msgspec import Struct

from haptigraph.child_process import pipe_of, start_child
from haptigraph.messages import Capabilities

__all__ = ["GO", "Command", "Reply", "WatchdogProcess"]

GO = b"go\n"
"""Lets the process open the device."""


class Command(Struct, array_like=True):
    """One setting of the device."""

    number: int
    amplitude: float
    frequency_hz: float
    stamp_ns: int


class Reply(Struct, array_like=True):
    """The result of a command; number 0 reports that the device is open."""

    number: int
    error: str = ""
    capabilities: Capabilities | None = None
    is_executed: bool = True
    """False: the process has received the command, and executes it next."""


class WatchdogProcess:
    """Start a watchdog process; it opens the device on command.

    Raises:
        OSError: If it cannot be started.
    """

    def __init__(self, arguments: Sequence[str]) -> None:
        self.process = start_child(arguments)
        self.replies: queue.SimpleQueue[Reply] = queue.SimpleQueue()
        self.is_open = False
        """Whether it has reported that the device is open."""
        self.called_s = math.inf
        """When it was called on to open the device."""
        pipe = pipe_of(self.process.stdout)
        threading.Thread(
            target=_read_replies, args=(pipe, self.replies), name="haptigraph-watchdog", daemon=True
        ).start()

    def go(self) -> None:
        """Let it open the device."""
        self.called_s = time.monotonic()
        self.write(GO)

    def write(self, line: bytes) -> None:
        """Send a line; lost if the process has ended."""
        with suppress(BrokenPipeError):
            pipe_of(self.process.stdin).write(line)

    def kill(self) -> None:
        """End it at once."""
        self.process.kill()
        self.process.wait()
        pipe_of(self.process.stdin).close()


def _read_replies(pipe: IO[bytes], replies: "queue.SimpleQueue[Reply]") -> None:
    decode = msgspec.json.Decoder(Reply).decode
    while line := pipe.readline():
        replies.put(decode(line))
    pipe.close()
