"""Write files atomically: whoever reads one sees the old contents or the new."""

import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

__all__ = ["write_files"]


def write_files(files: Sequence[Path], contents: Sequence[bytes]) -> None:
    """Write all files to temporary ones beside them first, then rename these.

    Raises:
        OSError: If one cannot be written; no temporary file remains.
    """
    temporary: list[tuple[str, Path]] = []
    try:
        for file, content in zip(files, contents, strict=True):
            handle, name = tempfile.mkstemp(dir=file.parent, prefix=f".{file.name}.")
            temporary.append((name, file))
            with os.fdopen(handle, "wb") as part:
                part.write(content)
        for name, file in temporary:
            Path(name).chmod(0o644)
            Path(name).replace(file)
    finally:
        for name, _ in temporary:
            Path(name).unlink(missing_ok=True)
