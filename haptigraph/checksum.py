"""SHA-256: of a file, and as a source of pseudo-random numbers."""

import hashlib
from pathlib import Path

__all__ = ["hashed_integer", "sha256_of"]


def sha256_of(file: str | Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal digits."""
    with Path(file).open("rb") as opened:
        return hashlib.file_digest(opened, "sha256").hexdigest()


def hashed_integer(*key: object) -> int:
    """Return a pseudo-random number in [0, 2^63) that depends on the key alone."""
    digest = hashlib.sha256("/".join(str(part) for part in key).encode()).digest()
    return int.from_bytes(digest[:8]) >> 1
