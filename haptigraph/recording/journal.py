"""MCAP files during a run: appended record by record, and complete up to the last record at any time."""

import os
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.records import DataEnd, Footer, McapRecord
from mcap.stream_reader import StreamReader

from haptigraph.errors import BadInput

try:
    import fcntl
except ImportError:  # Windows has no such locks, but does not let an open file be replaced
    fcntl = None  # type: ignore[assignment]

__all__ = [
    "Journal",
    "complete_records",
    "is_being_written",
    "is_whole",
    "not_being_written",
    "records_between",
]

MAGIC = b"\x89MCAP0\r\n"
RECORD_HEADER = struct.Struct("<BQ")  # opcode, length
DAMAGE = (McapError, zstandard.ZstdError, struct.error, ValueError, OverflowError, MemoryError)


class Journal:
    """A file that passes every write to the operating system at once, so that a killed process loses nothing.

    The file is locked until it is closed, if the system can, and so not mistaken for an interrupted one.

    Args:
        descriptor: An open file descriptor; the journal owns it.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor: int | None = descriptor
        self._written = 0
        _lock(descriptor, "LOCK_EX")

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._descriptor is None

    def write(self, data: bytes) -> int:
        """Write all bytes.

        Raises:
            OSError: If they cannot be written.
        """
        if self._descriptor is None:
            raise ValueError("write to a closed journal")
        unwritten = memoryview(data)
        while unwritten:
            unwritten = unwritten[os.write(self._descriptor, unwritten) :]
        self._written += len(data)
        return len(data)

    def tell(self) -> int:
        """Return the number of bytes written."""
        return self._written

    def flush(self) -> None:
        """Do nothing: writes are not buffered."""

    def close(self) -> None:
        """Sync the file to the disk and close it. May be called twice."""
        if self._descriptor is not None:
            descriptor, self._descriptor = self._descriptor, None
            try:
                os.fsync(descriptor)
            finally:
                os.close(descriptor)


def is_being_written(path: Path) -> bool:
    """Return whether a process still has the journal open; False if the system has no locks."""
    with path.open("rb") as file:
        return not _lock(file.fileno(), "LOCK_SH", "LOCK_NB")


@contextmanager
def not_being_written(
    path: Path, problem: str = "is still being written; end that run first"
) -> Iterator[None]:
    """Lock a recording, or another file, exclusively.

    Raises:
        BadInput: If another process has locked it, with `problem` as the message.
    """
    if fcntl is None:
        yield
        return
    with path.open("rb") as file:
        if not _lock(file.fileno(), "LOCK_EX", "LOCK_NB"):
            raise BadInput(problem, path)
        yield


def _lock(descriptor: int, *flags: str) -> bool:
    """Lock an open file; False if another process has locked it. Without support for locks, do nothing."""
    try:
        if fcntl is not None:
            fcntl.flock(descriptor, sum(getattr(fcntl, flag) for flag in flags))
    except BlockingIOError:
        return False
    except OSError:
        pass
    return True


def is_whole(path: Path) -> bool:
    """Return whether a recording was closed properly."""
    with path.open("rb") as file:
        file.seek(0, os.SEEK_END)
        if file.tell() < 2 * len(MAGIC):
            return False
        file.seek(-len(MAGIC), os.SEEK_END)
        return file.read() == MAGIC


def complete_records(path: Path) -> Iterator[tuple[int, McapRecord]]:
    """Yield the records of a recording's data section, up to the last complete one.

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
            for record in StreamReader(file, validate_crcs=True).records if end > len(MAGIC) else ():
                if isinstance(record, DataEnd | Footer):
                    return
                yield file.tell(), record
                if file.tell() >= end:
                    return
        except DAMAGE as error:
            raise BadInput(f"damaged ({error})", path, f"byte {file.tell()}") from None


def records_between(path: Path, start: int, end: int) -> Iterator[tuple[int, McapRecord]]:
    """Yield the records between two byte offsets at record boundaries, like `complete_records`.

    Raises:
        BadInput: If they cannot be read.
    """
    try:
        with path.open("rb") as file:
            file.seek(start)
            part = BytesIO(file.read(end - start))
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", path) from None
    try:
        for record in StreamReader(part, skip_magic=True, validate_crcs=True).records:
            yield start + part.tell(), record
    except EndOfFile:
        return
    except DAMAGE as error:
        raise BadInput(f"damaged ({error})", path, f"byte {start + part.tell()}") from None


def _end_of_complete_records(file: BinaryIO) -> int:
    """Return the byte offset at which the last complete record ends; reads the lengths only."""
    size = os.fstat(file.fileno()).st_size
    end = len(MAGIC)
    while end + RECORD_HEADER.size <= size:
        file.seek(end)
        _, length = RECORD_HEADER.unpack(file.read(RECORD_HEADER.size))
        if end + RECORD_HEADER.size + length > size:
            break
        end += RECORD_HEADER.size + length
    return end
