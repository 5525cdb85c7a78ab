"""The checksums of an export, in `SHA256SUMS`."""

from pathlib import Path

from haptigraph.checksum import sha256_of
from haptigraph.errors import BadInput

__all__ = ["CHECKSUMS", "verify_checksums", "write_checksums"]

CHECKSUMS = "SHA256SUMS"


def write_checksums(folder: Path) -> None:
    """Write `SHA256SUMS` over all files below a folder, as `sha256sum --check` reads it."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    lines = [f"{sha256_of(file)}  {file.relative_to(folder).as_posix()}\n" for file in files]
    (folder / CHECKSUMS).write_text("".join(lines), "utf-8")


def verify_checksums(folder: Path) -> None:
    """Compare the files of an export with their checksums, if it has a list of them.

    Raises:
        BadInput: If a file is missing, or was changed after the export.
    """
    path = folder / CHECKSUMS
    if not path.exists():
        return
    try:
        for number, line in enumerate(path.read_text("ascii").splitlines(), 1):
            checksum, _, name = line.partition("  ")
            if not name or Path(name).name != name:
                problem = f"expected a checksum, two spaces and a file's name; found {line[:40]!r}"
                raise BadInput(problem, path, f"line {number}")
            if sha256_of(folder / name) != checksum:
                problem = f"was changed after the export; to import it as it is, delete {CHECKSUMS}"
                raise BadInput(problem, folder / name)
    except OSError as error:
        raise BadInput(f"cannot be read ({error.strerror})", error.filename or path) from None
    except UnicodeDecodeError:
        raise BadInput("is not a list of checksums", path) from None
