"""What a check of a set-up found wrong, and its report as a file."""

from pathlib import Path

import msgspec
from msgspec import Struct

from haptigraph.errors import BadInput
from haptigraph.files import write_files

__all__ = ["Finding", "write_report"]


class Finding(Struct, frozen=True):
    """One problem."""

    name: str
    sentence: str
    """What was found, and what would be valid."""


def write_report(report: Struct, path: Path) -> None:
    """Write a report as JSON, atomically, in place of an older one.

    Raises:
        BadInput: If it cannot be written.
    """
    content = msgspec.json.format(msgspec.json.encode(report), indent=2) + b"\n"
    try:
        write_files((path,), (content,))
    except OSError as error:
        raise BadInput(f"cannot be written ({error.strerror})", path) from None
