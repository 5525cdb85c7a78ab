"""From a file to its SHA-256."""

import hashlib
from pathlib import Path

__all__ = ["sha256_of"]


def sha256_of(file: str | Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits."""
    with Path(file).open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()
