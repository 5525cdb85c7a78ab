"""Find the recordings below a folder."""

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from haptigraph.errors import BadInput

__all__ = ["Found", "check_folder", "found_recordings"]


class Found(NamedTuple):
    """A recording; with another size or time of change it is another one."""

    name: str
    """Path relative to the folder."""
    size: int
    changed_ns: int
    """Since 1970."""


def check_folder(folder: Path) -> None:
    """Refuse what is no folder.

    Raises:
        BadInput: If it is none.
    """
    if not folder.is_dir():
        raise BadInput("is no folder; give one with recordings", folder)


def found_recordings(folder: Path) -> Iterator[Found]:
    """Yield every recording below a folder, in the order of the names; none that a link has outside of it.

    Raises:
        BadInput: If there is no such folder.
    """
    check_folder(folder)
    for path in sorted(folder.rglob("*.mcap")):
        with suppress(FileNotFoundError):  # removed meanwhile
            if path.is_file() and _is_inside(path, folder):
                found = path.stat()
                yield Found(path.relative_to(folder).as_posix(), found.st_size, found.st_mtime_ns)


def _is_inside(path: Path, folder: Path) -> bool:
    return not path.is_symlink() or path.resolve().is_relative_to(folder.resolve())
