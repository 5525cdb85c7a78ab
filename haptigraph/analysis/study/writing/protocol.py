"""Paragraph of the methods section on the frozen protocol, and whether it was edited afterwards."""

from haptigraph.analysis.study.results import StudyResults
from haptigraph.analysis.study.tables import StudyTables
from haptigraph.analysis.words import counted

__all__ = ["edited_note", "protocol_paragraph"]


def edited_note(tables: StudyTables) -> str:
    """Return a sentence for the top of the report if the protocol was edited; otherwise the empty text."""
    if not (edited := tables.protocol.edited_parts):
        return ""
    was = "was" if len(edited) == 1 else "were"
    return (
        f"The protocol was edited after the first participant: {', '.join(edited)} {was} changed. This "
        "report follows the protocol as it was frozen with the first participant."
    )


def protocol_paragraph(tables: StudyTables, results: StudyResults) -> str:
    """Return when the protocol was frozen, whether it was edited since, and which procedures were run."""
    protocol = tables.protocol
    if not protocol.frozen_utc:
        return "Whether the protocol was edited after the first participant is not known: no text was kept."
    when = protocol.frozen_utc[:16].replace("T", " ")
    frozen = f"The first participant froze the protocol ({when} UTC, SHA-256 {protocol.sha256})."
    if protocol.edited_parts is None:
        edited = "Whether it was edited afterwards is not known: its files were not compared at the export."
    elif protocol.edited_parts:
        edited = f"{edited_note(tables)} An edited protocol enrols nobody and opens no session."
    else:
        edited = "Its files had not been edited when the data were exported."
    return f"{frozen} {edited}{_procedures(results, protocol.procedure_sha256s)}"


def _procedures(results: StudyResults, frozen: frozenset[str]) -> str:
    """Return how many runs have the text of a frozen procedure, as far as that is known."""
    if not frozen or "procedure_sha256" not in results.runs:
        return ""
    run = results.runs["procedure_sha256"].dropna()
    run = run[run != ""]
    others = int((~run.isin(list(frozen))).sum())
    if not others:
        return (
            f" All {len(run)} runs with a known procedure have the text of a frozen one." if len(run) else ""
        )
    return (
        f" Of {counted(len(run), 'run')} with a known procedure, {others} have another text than a frozen "
        "one. An update of haptigraph may have worded it differently; compare the recordings with study.json."
    )
