"""Files of results: whether they are about the software and the procedure in question."""

from haptigraph.analysis.evaluation.origin import Origin
from haptigraph.analysis.evidence.case import Status

__all__ = ["standing"]


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
