"""Messages through the pipes of a child process whose loop must never wait for them."""

import os
import struct
from contextlib import suppress
from typing import Generic, TypeVar

import msgspec
from msgspec import Struct

__all__ = ["Frames", "PipeReader", "PipeWriter", "framed"]

T = TypeVar("T")
LENGTH = struct.Struct(">I")
MAX_BACKLOG = 1 << 18  # bytes that nobody reads, before messages are dropped
READ_SIZE = 1 << 16


def framed(message: Struct) -> bytes:
    """Return a message as its length and MessagePack, which unlike JSON keeps nan."""
    data = msgspec.msgpack.encode(message)
    return LENGTH.pack(len(data)) + data


class Frames:
    """Split a stream of bytes into the messages that `framed` wrote."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def add(self, data: bytes, kind: type[T]) -> list[T]:
        """Return the messages that are complete now.

        Raises:
            msgspec.MsgspecError: If one is not of this kind.
        """
        self._buffer += data
        messages = []
        while len(self._buffer) >= LENGTH.size:
            end = LENGTH.size + LENGTH.unpack_from(self._buffer)[0]
            if len(self._buffer) < end:
                break
            messages.append(msgspec.msgpack.decode(self._buffer[LENGTH.size : end], type=kind))
            del self._buffer[:end]
        return messages


class PipeReader(Generic[T]):
    """Messages of one kind from a pipe.

    Args:
        descriptor: The pipe.
        kind: Of the messages.
    """

    def __init__(self, descriptor: int, kind: type[T]) -> None:
        os.set_blocking(descriptor, False)
        self._descriptor, self._kind, self._frames = descriptor, kind, Frames()

    def take(self) -> list[T] | None:
        """Return the messages since the last call; None at the end of the pipe. Does not block."""
        messages: list[T] = []
        with suppress(BlockingIOError):
            while True:
                data = os.read(self._descriptor, READ_SIZE)
                if not data:
                    return None
                messages += self._frames.add(data, self._kind)
        return messages


class PipeWriter:
    """Messages to a pipe. If nobody reads it, they are dropped.

    Args:
        descriptor: The pipe.
    """

    def __init__(self, descriptor: int) -> None:
        os.set_blocking(descriptor, False)
        self._descriptor, self._left = descriptor, bytearray()

    def send(self, message: Struct) -> None:
        """Send a message, or drop it. Does not block."""
        if len(self._left) < MAX_BACKLOG:
            self._left += framed(message)
        with suppress(OSError):  # full, or nobody is there any more, which the end of the input says too
            while self._left:
                del self._left[: os.write(self._descriptor, self._left)]
