"""Files of results: their hash, and whether they are about the software and the procedure in question."""

import hashlib
from pathlib import Path

from haptigraph.analysis.evaluation.origin import Origin
from haptigraph.analysis.evidence.case import Status

__all__ = ["sha256_of", "standing"]


def sha256_of(path: str | Path) -> str:
    """Return the hash of a file."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def standing(made: Origin | None, origin: Origin) -> tuple[Status, str] | None:
    """Return why a result does not count, as a status and in words; None if it does.

    Args:
        made: What made the result; None if it does not state it.
        origin: The software and the procedure that it must be about.
    """
    if made is None:
        return "origin not stated", "the file does not state software and procedure"
    if made.procedure_sha256 != origin.procedure_sha256:
        return "other procedure", f"about {made.procedure} (sha256 {made.procedure_sha256[:12]})"
    if made.software_sha256 != origin.software_sha256:
        return "stale", f"made by other software ({made.version} {made.commit[:12]})".replace(" )", ")")
    return None
