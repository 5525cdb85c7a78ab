"""Write an export as a file of its own."""

from contextlib import suppress
from pathlib import Path

from haptigraph.errors import BadInput

__all__ = ["write_new"]


def write_new(path: str | Path, content: bytes) -> None:
    """Write a file that does not exist yet; nothing of it remains if that fails.

    Raises:
        BadInput: If it exists or cannot be written.
    """
    opened = False
    try:
        with open(path, "xb") as file:
            opened = True
            file.write(content)
    except FileExistsError:
        raise BadInput("exists already; choose another name", path) from None
    except OSError as error:  # that of a full disk does not name the file
        with suppress(OSError):
            if opened:
                Path(path).unlink()
        raise BadInput(f"cannot be written ({error.strerror})", path) from None
