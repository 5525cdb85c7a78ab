"""Create a folder whole or not at all."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from haptigraph.errors import BadInput

__all__ = ["new_folder"]


@contextmanager
def new_folder(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder, which becomes the new one if the context ends without an error.

    Raises:
        BadInput: If the folder exists or cannot be written.
    """
    if folder.exists():
        raise BadInput("exists already; an export never overwrites", folder)
    try:
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
        try:
            yield temporary
            temporary.chmod(0o755)
            os.rename(temporary, folder)
        except BaseException:
            shutil.rmtree(temporary, ignore_errors=True)
            raise
    except OSError as error:
        raise BadInput(f"cannot be written ({error.strerror})", folder) from None
