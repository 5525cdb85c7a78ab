"""The report of a check: text for the terminal, JSON to keep (read by `robot.check_report`)."""

from collections.abc import Iterator
from datetime import UTC, datetime

from haptigraph.findings import Finding
from haptigraph.robot.check_report import CheckReport
from haptigraph.robot.checking.judging import Judgement
from haptigraph.version import __version__

__all__ = ["FullReport", "full_report", "lines"]


class FullReport(CheckReport, frozen=True):
    """Everything that a check found."""

    findings: tuple[Finding, ...]
    not_exercised: tuple[str, ...]
    measurements: dict[str, float]
    """By name, with the unit at its end."""


def full_report(uri: str, judgement: Judgement) -> FullReport:
    """Return the report of a robot, as of now."""
    return FullReport(
        uri=uri,
        passed=judgement.passed,
        utc=datetime.now(UTC).isoformat(timespec="seconds"),
        software_version=__version__,
        findings=judgement.findings,
        not_exercised=judgement.not_exercised,
        measurements=judgement.measurements,
    )


def lines(report: FullReport) -> Iterator[str]:
    """Yield the report as text."""
    for name, value in report.measurements.items():
        yield f"{name:24} {value:.6g}"
    for finding in report.findings:
        yield f"FAILED {finding.name}: {finding.sentence}"
    for sentence in report.not_exercised:
        yield f"not exercised: {sentence}"
    outcome = "passed" if report.passed else f"did not pass: {len(report.findings)} findings"
    yield f"{report.uri} {outcome}"
