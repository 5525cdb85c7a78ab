"""A safety case as tables: Markdown to read, CSV for other programs."""

import csv
import io

from haptigraph.analysis.evidence.accuracy_evidence import BARS
from haptigraph.analysis.evidence.case import Claim, Evidence, SafetyCase

__all__ = ["NOTES", "csv_table", "facts", "markdown", "outcome", "status_text"]

NOTES = (
    "haptigraph is research software, not a medical device. This page claims no compliance with ISO 14971 or "
    "any other standard. It lists what was proved and measured, for others to judge.",
    "The hazards are those of haptic guidance by pictures that the project knows. Hazards of the operation, "
    "the robot, the actuator and the people who use them are not covered.",
    "The accuracy bars are the project's own, not those of a standard. Accuracy on simulated or rendered "
    "pictures says nothing about pictures of another eye or another camera.",
    "Proofs are about the rules: from what perception reports to what is felt. They do not say that "
    "perception is right.",
)
COLUMNS = (
    *("hazard_id", "hazard", "harm", "claim_id", "claim", "evidence_id", "source", "status", "figure", "bar"),
    *("command", "file", "sha256", "version", "commit", "made"),
)


def status_text(claim: Claim, evidence: Evidence) -> str:
    """Return the status of evidence, in capital letters if its claim does not hold because of it."""
    return evidence.status.upper() if claim.lacks(evidence) else evidence.status


def outcome(case: SafetyCase) -> str:
    """Return the outcome in one sentence."""
    counts = case.counts()
    total, held = sum(counts.values()), counts.pop("holds")
    if case.holds:
        return f"all {total} claims hold"
    rest = ", ".join(f"{count} {status.replace('fails', 'fail')}" for status, count in counts.items())
    return f"{held} of {total} claims hold; the others: {rest}"


def facts(case: SafetyCase) -> list[tuple[str, str]]:
    """Return what the safety case is about, as names and values."""
    made = case.origin
    return [
        ("procedure", f"{case.title} ({case.file}), sha256 {made.procedure_sha256}"),
        ("software", f"haptigraph {made.version}, {f'commit {made.commit}' if made.commit else 'installed'}"),
        ("sha256 of the software", made.software_sha256),
        ("made", made.made_utc),
        ("command", made.command),
    ]


def csv_table(case: SafetyCase) -> str:
    """Return one row for each piece of evidence."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(COLUMNS)
    for hazard_id, hazard, claim_id, claim, number, each in case.rows():
        rows.writerow(
            (
                *(hazard_id, hazard.hazard, hazard.harm, claim_id, claim.statement, number, each.source),
                *(each.status, each.figure, each.bar, each.command, each.file, each.sha256),
                *(each.version, each.commit, each.made),
            )
        )
    return text.getvalue()


def markdown(case: SafetyCase) -> str:
    """Return the whole safety case as Markdown, without the diagram."""
    lines = [f"# Evidence: {case.title}", "", f"**{outcome(case)}**", ""]
    lines += [f"* {name}: {_cell(value)}" for name, value in facts(case)]
    lines += ["", *(f"{note}\n" for note in NOTES)]
    for place, hazard in enumerate(case.hazards, 1):
        lines += [f"## H{place} {hazard.hazard}", "", f"Harm: {hazard.harm}.", ""]
        lines += ["| | claim | evidence | status | figure | passes if | command | origin |"]
        lines += ["|---|---|---|---|---|---|---|---|"]
        for hazard_id, _, claim_id, claim, number, each in case.rows():
            if hazard_id == f"H{place}":
                text = status_text(claim, each)
                status = f"**{text}**" if claim.lacks(each) else text
                cells = (
                    *(claim_id, claim.statement, f"{number}, {each.source}", status),
                    *(each.figure, each.bar, f"`{each.command}`" if each.command else "", _origin(each)),
                )
                lines.append("| " + " | ".join(map(_cell, cells)) + " |")
        lines.append("")
    lines += ["## Accuracy bars", "", "| score | bar |", "|---|---|"]
    lines += [f"| {_cell(bar.statement)} | {bar.text} |" for bar in BARS]
    return "\n".join([*lines, ""])


def _origin(evidence: Evidence) -> str:
    parts = (
        evidence.file,
        evidence.sha256 and f"sha256 {evidence.sha256}",
        evidence.version,
        evidence.commit and f"commit {evidence.commit}",
        evidence.made,
    )
    return ", ".join(part for part in parts if part)


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("<", "&lt;").replace("\n", " ")
