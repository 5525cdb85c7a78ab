"""Where a result comes from: software, commit, date and command, so that others can judge and repeat it."""

import hashlib
import shlex
import subprocess
import sys
from datetime import UTC, datetime
from functools import cache
from pathlib import Path

from msgspec import Struct

import haptigraph
from haptigraph.inference.procedure import Procedure
from haptigraph.version import __version__

__all__ = ["Origin", "commit", "new_origin", "software_sha256"]

PACKAGE = Path(haptigraph.__file__).parent
LEFT_OUT = (".c", ".h", ".ts", ".pyc", ".library")
"""Not in every installation: C code, which the compiled library's checksum stands for, and types."""


class Origin(Struct, frozen=True):
    """What made a result."""

    version: str
    commit: str
    """Of the checkout; empty if the package was not run from one."""
    software_sha256: str
    """Of the package, so that a result can be assigned to it without a checkout."""
    made_utc: str
    """ISO 8601."""
    command: str
    procedure: str = ""
    procedure_sha256: str = ""


def new_origin(procedure: Procedure | None = None, command: str = "") -> Origin:
    """Return the origin of a result that this process makes now.

    Args:
        procedure: The rules that were applied, if any.
        command: How to make it again; empty: the command line of this process.
    """
    return Origin(
        version=__version__,
        commit=commit(),
        software_sha256=software_sha256(),
        made_utc=datetime.now(UTC).isoformat(timespec="seconds"),
        command=command or shlex.join(["haptigraph", *sys.argv[1:]]),
        procedure=procedure.name if procedure else "",
        procedure_sha256=procedure.sha256 if procedure else "",
    )


@cache
def commit() -> str:
    """Return the commit of the checkout that the package is in, with a note if the package was changed.

    Returns:
        Empty if there is no git, or the package is installed, also beside another project's repository.
    """
    top = _git("rev-parse", "--show-toplevel")
    if not top or Path(top).resolve() != PACKAGE.parent.resolve():
        return ""
    head = _git("rev-parse", "HEAD")
    changed = _git("status", "--porcelain", "--", PACKAGE.name)
    return f"{head} with uncommitted changes" if head and changed else head


@cache
def software_sha256() -> str:
    """Return a hash of all that the package consists of, the same in a checkout and an installation."""
    from haptigraph.perception.native.compiled import sources_crc32  # noqa: PLC0415 - loads the C library

    total = hashlib.sha256(f"{sources_crc32():08x}".encode())
    for file in sorted(PACKAGE.rglob("*.*")):
        if file.is_file() and file.suffix not in LEFT_OUT:
            content = hashlib.sha256(file.read_bytes()).hexdigest()
            total.update(f"{file.relative_to(PACKAGE).as_posix()} {content}\n".encode())
    return total.hexdigest()


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(PACKAGE.parent), *arguments]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""
