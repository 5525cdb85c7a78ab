"""Files during a run: complete up to the last record at any time, locked, and watched by their writer."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from mcap.records import DataEnd, McapRecord

from haptigraph.errors import BadInput, HaptigraphError
from haptigraph.recording.scan import MAGIC, Damage, open_regular, scan, scan_between

try:
    import fcntl
except ImportError:  # Windows has no such locks, but does not let an open file be replaced
    fcntl = None  # type: ignore[assignment]

__all__ = [
    "FileChanged",
    "FileIdentity",
    "Journal",
    "complete_records",
    "is_being_written",
    "is_whole",
    "lock",
    "not_being_written",
    "records_between",
]


class FileChanged(HaptigraphError):
    """Somebody else deleted, replaced or changed a file while it was in use."""


class FileIdentity(NamedTuple):
    """Identity of a file, to check that a path still leads to it, unchanged."""

    device: int
    inode: int
    size: int

    @classmethod
    def of(cls, file: Path | int) -> "FileIdentity":
        """Return the identity of a path or an open file descriptor."""
        found = os.stat(file)
        return cls(found.st_dev, found.st_ino, found.st_size)

    def check(self, path: Path) -> None:
        """Check that a path leads to this file.

        Raises:
            FileChanged: If not.
        """
        try:
            now = FileIdentity.of(path)
        except FileNotFoundError:
            raise FileChanged("it was deleted or moved while it was in use") from None
        if now[:2] != self[:2]:
            raise FileChanged("another file has taken its place while it was in use")
        if now.size != self.size:
            raise FileChanged(f"it was changed while it was in use: {now.size} bytes instead of {self.size}")


class Journal:
    """A file that passes every write to the operating system at once, so that a killed process loses nothing.

    The file is locked until it is closed, if the system can, and so not mistaken for an interrupted one.

    Args:
        descriptor: An open file descriptor of an empty file; the journal owns it.
        path: Its path; every write checks that it still leads there. None: unknown.
    """

    def __init__(self, descriptor: int, path: Path | None = None) -> None:
        self._descriptor: int | None = descriptor
        self._path = path
        self._identity = FileIdentity.of(descriptor)
        self._written = 0
        lock(descriptor, "LOCK_EX")

    @property
    def closed(self) -> bool:
        """Whether `close` was called."""
        return self._descriptor is None

    def write(self, data: bytes) -> int:
        """Write all bytes.

        Raises:
            FileChanged: If the file was deleted, replaced or changed.
            OSError: If they cannot be written.
        """
        if self._descriptor is None:
            raise ValueError("write to a closed journal")
        self.check()
        unwritten = memoryview(data)
        while unwritten:
            unwritten = unwritten[os.write(self._descriptor, unwritten) :]
        self._written += len(data)
        return len(data)

    def rewind(self, to: int) -> None:
        """Remove what was written behind a byte offset.

        Raises:
            OSError: If that is impossible.
        """
        if self._descriptor is not None:
            os.ftruncate(self._descriptor, to)
            os.lseek(self._descriptor, to, os.SEEK_SET)
            self._written = to

    def check(self) -> FileIdentity:
        """Check that the path still leads to the file, with all that was written; return its identity.

        Raises:
            FileChanged: If not.
        """
        identity = self._identity._replace(size=self._written)
        if self._path is not None:
            identity.check(self._path)
        return identity

    def is_at_its_path(self) -> bool:
        """Return whether the path still leads to the file."""
        try:
            return self._path is not None and FileIdentity.of(self._path)[:2] == self._identity[:2]
        except OSError:
            return False

    def tell(self) -> int:
        """Return the number of bytes written."""
        return self._written

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
        return not lock(file.fileno(), "LOCK_SH", "LOCK_NB")


@contextmanager
def not_being_written(
    path: Path, problem: str = "is still being written; end that run first"
) -> Iterator[None]:
    """Lock a recording, or another file, exclusively.

    Raises:
        BadInput: If another process has locked it, with `problem` as the message, or it cannot be read.
    """
    if fcntl is None:
        yield
        return
    with open_regular(path) as file:
        if not lock(file.fileno(), "LOCK_EX", "LOCK_NB"):
            raise BadInput(problem, path)
        yield


def lock(descriptor: int, *flags: str) -> bool:
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


def complete_records(path: Path, *, verifies_attachments: bool = True) -> Iterator[tuple[int, McapRecord]]:
    """Yield the records of a recording's data section, up to the last complete one.

    Args:
        path: The recording.
        verifies_attachments: Whether attachments, which may be large, are read, and not only found.

    Yields:
        (byte offset of the end of the record, or of its chunk; record).

    Raises:
        BadInput: If the file cannot be read, is not MCAP, or is damaged before its last complete record.
    """
    with open_regular(path) as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise BadInput("not a recording (an MCAP file begins otherwise)", path)
    for piece in scan(path, verifies_attachments=verifies_attachments):
        if isinstance(piece, Damage):
            if piece.kind in ("torn", "cut"):
                return
            saves = "`haptigraph recover` saves what can be read"
            raise BadInput(f"damaged ({piece.problem}); {saves}", path, f"byte {piece.start}")
        for record in piece.records if piece.is_data else ():
            if not isinstance(record, DataEnd):
                yield piece.end, record


def records_between(path: Path, start: int, end: int) -> Iterator[tuple[int, McapRecord]]:
    """Yield the records between two byte offsets at record boundaries, like `complete_records`.

    Raises:
        BadInput: If they cannot be read.
    """
    for piece in scan_between(path, start, end):
        for record in piece.records:
            yield piece.end, record
