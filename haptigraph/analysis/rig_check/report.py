"""The report of a check: text for the terminal, JSON to keep."""

from collections.abc import Iterator
from datetime import UTC, datetime

from msgspec import Struct

from haptigraph.analysis.rig_check.judging import Judgement
from haptigraph.analysis.rig_check.subject import Outcome, Subject
from haptigraph.findings import Finding
from haptigraph.version import __version__

__all__ = ["JudgedSubject", "Report", "lines", "report_of"]


class JudgedSubject(Subject, frozen=True, kw_only=True):
    """A subject with its outcome, for readers of the JSON."""

    judged: Outcome


class Report(Struct, frozen=True):
    """Everything that a check found."""

    source: str
    registration_sha256: str
    rig: str
    """Name of the rig; empty: none was given."""
    passed: bool
    """Whether nothing was found, and everything was judged or need not be."""
    utc: str
    """When it was checked: ISO 8601."""
    software_version: str
    subjects: tuple[JudgedSubject, ...]


def report_of(
    judgement: Judgement, source: str, registration_sha256: str, rig: str, *, accepts_unjudged: bool
) -> Report:
    """Return the report of a rig, as of now.

    Args:
        judgement: What was found.
        source: The source, as the user wrote it.
        registration_sha256: Fingerprint of the registration.
        rig: Name of the rig; empty: none was given.
        accepts_unjudged: Whether it may pass although something could not be judged.
    """
    return Report(
        source=source,
        registration_sha256=registration_sha256,
        rig=rig,
        passed=not judgement.findings and (accepts_unjudged or not judgement.not_judged),
        utc=datetime.now(UTC).isoformat(timespec="seconds"),
        software_version=__version__,
        subjects=tuple(
            JudgedSubject(each.name, each.measurements, each.findings, each.not_judged, judged=each.outcome)
            for each in judgement.subjects
        ),
    )


def lines(report: Report) -> Iterator[str]:
    """Yield the report as text."""
    for subject in report.subjects:
        values = ", ".join(f"{name} {value:.4g}" for name, value in subject.measurements.items())
        yield f"{subject.judged:10}  {subject.name:12}  {values}".rstrip()
    yield ""
    findings = [finding for subject in report.subjects for finding in subject.findings]
    for finding in findings:
        yield f"FAILED {finding.name}: {finding.sentence}"
    for subject in report.subjects:
        if subject.not_judged:
            yield f"not judged, {subject.name}: {subject.not_judged}"
    unjudged = sum(bool(subject.not_judged) for subject in report.subjects)
    outcome = "passed" if report.passed else "did not pass"
    yield f"{report.source} {outcome}: {_counted(findings)}, {unjudged} of {len(report.subjects)} not judged"


def _counted(findings: list[Finding]) -> str:
    return f"{len(findings)} finding{'' if len(findings) == 1 else 's'}"
