"""The outcome of checking one subject."""

from typing import Literal

from msgspec import Struct

from haptigraph.findings import Finding

__all__ = ["Outcome", "Subject"]

Outcome = Literal["passed", "failed", "not judged"]


class Subject(Struct, frozen=True):
    """One subject: what was measured, what is wrong, and what could not be judged."""

    name: str
    measurements: dict[str, float] = {}
    """By name, with the unit at its end."""
    findings: tuple[Finding, ...] = ()
    not_judged: str = ""
    """Why it could not be judged, or not all of it, in one sentence; empty if it was."""

    @property
    def outcome(self) -> Outcome:
        """Whether it passed; what could not be judged did not pass."""
        if self.findings:
            return "failed"
        return "not judged" if self.not_judged else "passed"
