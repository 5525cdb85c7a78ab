"""MCAP files while a run is being written: appended record by record, whole up to the last one."""

import os
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from mcap.exceptions import McapError
from mcap.records import DataEnd, Footer, McapRecord
from mcap.stream_reader import StreamReader

from haptigraph.errors import BadInput

__all__ = ["Journal", "complete_records", "is_whole"]

MAGIC = b"\x89MCAP0\r\n"
HEAD = struct.Struct("<BQ")  # opcode, length


class Journal:
    """A file that hands every write to the operating system at once; a killed process loses nothing.

    Args:
        descriptor: An open file descriptor; owned from here on.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor: int | None = descriptor
        self._written = 0

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._descriptor is None

    def write(self, data: bytes) -> int:
        """Write all of it.

        Raises:
            OSError: If the disk does not take it.
        """
        if self._descriptor is None:
            raise ValueError("write to a closed journal")
        left = memoryview(data)
        while left:
            left = left[os.write(self._descriptor, left) :]
        self._written += len(data)
        return len(data)

    def tell(self) -> int:
        """Return how many bytes were written."""
        return self._written

    def flush(self) -> None:
        """Do nothing: nothing is held back."""

    def close(self) -> None:
        """Bring the file to the disk and close it. May be called twice."""
        if self._descriptor is not None:
            os.fsync(self._descriptor)
            os.close(self._descriptor)
            self._descriptor = None


def is_whole(path: Path) -> bool:
    """Tell whether a recording was closed properly."""
    with path.open("rb") as file:
        file.seek(0, os.SEEK_END)
        if file.tell() < 2 * len(MAGIC):
            return False
        file.seek(-len(MAGIC), os.SEEK_END)
        return file.read() == MAGIC


def complete_records(path: Path) -> Iterator[tuple[int, McapRecord]]:
    """Yield the records of a recording's data section, up to the last one that is complete.

    Yields:
        (bytes read so far, record).

    Raises:
        BadInput: If the file cannot be read or is not MCAP.
    """
    try:
        file = path.open("rb")
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", path) from None
    with file:
        if file.read(len(MAGIC)) != MAGIC:
            raise BadInput("not a recording (an MCAP file begins otherwise)", path)
        end = _end_of_complete_records(file)
        file.seek(0)
        try:
            for record in StreamReader(file).records if end > len(MAGIC) else ():
                if isinstance(record, DataEnd | Footer):
                    return
                yield file.tell(), record
                if file.tell() >= end:
                    return
        except (McapError, struct.error, UnicodeDecodeError, ValueError) as error:
            raise BadInput(f"damaged ({error})", path, f"byte {file.tell()}") from None


def _end_of_complete_records(file: BinaryIO) -> int:
    """Return where the last complete record ends; reads the lengths only."""
    size = os.fstat(file.fileno()).st_size
    end = len(MAGIC)
    while end + HEAD.size <= size:
        file.seek(end)
        _, length = HEAD.unpack(file.read(HEAD.size))
        if end + HEAD.size + length > size:
            break
        end += HEAD.size + length
    return end
