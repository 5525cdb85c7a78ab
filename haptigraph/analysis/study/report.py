"""Write the report of a study into one folder: page, figures, tables; equal data give equal bytes."""

from pathlib import Path

import pandas as pd
from msgspec import Struct

from haptigraph.analysis.study.calibration import calibration_paragraph, calibration_tables
from haptigraph.analysis.study.data_quality import flagged_trials, quality_by_condition
from haptigraph.analysis.study.detail_tables import detail_tables
from haptigraph.analysis.study.figures.drawn import draw_figures, figures_tex
from haptigraph.analysis.study.page import Picture, page
from haptigraph.analysis.study.paper import beside_paper
from haptigraph.analysis.study.participants import FOLDER, participant_pages
from haptigraph.analysis.study.results import AnalysisPlan, StudyResults, analyse
from haptigraph.analysis.study.results_table import hypothesis_table, latex, markdown, result_tables
from haptigraph.analysis.study.tables import StudyTables, read_tables
from haptigraph.analysis.study.traces import Traces, read_traces
from haptigraph.analysis.study.writing.findings import findings, warnings
from haptigraph.analysis.study.writing.methods import SIMULATED, methods, preregistered
from haptigraph.analysis.study.writing.protocol import edited_note
from haptigraph.errors import BadInput
from haptigraph.recording.writer import Progress
from haptigraph.version import __version__

__all__ = ["WrittenReport", "write_report"]

TESTS = [
    "measure",
    "first",
    "second",
    "status",
    "n_first",
    "n_second",
    "statistic",
    "p",
    "p_holm",
    "test",
    "effect",
    "shift_test",
]
SENSITIVITY = [
    "measure", "first", "second", "shapiro_p", "t_t", "t_df", "t_p", "t_difference", "t_d",
    "power_observed", "power_detectable_d", "power_needed",
]  # fmt: skip
CONDITION_COLUMNS = ("condition", "first", "second")
TITLES = {
    "tests": "All tests",
    "sensitivity": "Normality, t tests and power",
    "rank_test_variants": "All variants of the rank tests",
    "equivalence": "Equivalence (two one-sided tests)",
    "hit_rate": "Hit rate",
    "worst_rank": "Completion time with runs without a hit ranked last",
    "omnibus": "Omnibus tests of three or more conditions",
    "order_effects": "Order and learning (mixed models)",
    "hypotheses": "Preregistered hypotheses",
    "questionnaires_summary": "Scores of questionnaires by condition",
    "sus_summary": "SUS by condition",
    "sus": "SUS by participant",
    "thresholds": "Detection thresholds of vibration amplitude",
    "patterns_named": "Patterns named correctly, by participant",
    "confusion": "Patterns played and named, in the first round",
    "missing": "Missing data",
    "flagged_trials": "Trials beyond the protocol's thresholds of data quality",
    "data_quality": "Data quality by condition",
    "state_transitions": "Transitions between states",
}


class WrittenReport(Struct, frozen=True):
    """The files of a report."""

    page: Path
    files: list[Path]
    summary: str
    """The preregistered hypotheses, the paper's table, and the study beside the paper, in Markdown."""


def write_report(
    folder: str | Path,
    output: str | Path,
    plan: AnalysisPlan | None = None,
    recordings: str | Path | None = None,
    progress: Progress | None = None,
    *,
    has_participants: bool = True,
) -> WrittenReport:
    """Analyse the tables of a study and write the report.

    Args:
        folder: Contains the tables.
        output: A folder, created if missing; files of the same name are replaced.
        plan: The options of the analysis.
        recordings: The folder to which paths of recordings are relative; None: the folder of the tables.
        progress: Called with the progress.
        has_participants: Whether to write a page per participant as well.

    Raises:
        BadInput: If the tables or a recording are invalid; then nothing is written.
    """
    tables = read_tables(folder)
    results = analyse(tables, plan or AnalysisPlan())
    traces = read_traces(results.runs, Path(recordings or folder), progress)
    simulated = tables.is_simulated or traces.is_simulated
    files = _files(tables, results, traces, simulated=simulated, has_participants=has_participants)
    output = Path(output)
    try:
        for old in (output / FOLDER).glob("*.html"):
            if f"{FOLDER}/{old.name}" not in files:
                old.unlink()  # of someone who has withdrawn since
        for name, content in files.items():
            (output / name).parent.mkdir(parents=True, exist_ok=True)
            (output / name).write_bytes(content)
    except OSError as error:
        raise BadInput(f"cannot be written ({error.strerror})", error.filename or output) from None
    beside = beside_paper(results, simulated=simulated)
    shown = [*hypothesis_table(results), *result_tables(results)[:1], *([beside.table] if beside else [])]
    warned = warnings(results, flagged_trials(tables, results))
    found = [edited_note(tables), *warned, *findings(results), preregistered(results)]
    notes = [*found, *(beside.notes if beside else ())]
    summary = markdown(shown, SIMULATED if simulated else "", [note for note in notes if note])
    return WrittenReport(output / "report.html", [output / name for name in files], summary)


def _files(
    tables: StudyTables, results: StudyResults, traces: Traces, *, simulated: bool, has_participants: bool
) -> dict[str, bytes]:
    """Return the content of every file by its path in the folder."""
    note = SIMULATED if simulated else ""
    summaries = [*hypothesis_table(results), *result_tables(results)]
    beside = beside_paper(results, simulated=simulated)
    paragraphs = methods(tables, results, traces, simulated=simulated)
    details = detail_tables(results)
    quality = {
        "data_quality": quality_by_condition(tables),
        "flagged_trials": flagged_trials(tables, results),
    }
    details |= {name: table for name, table in quality.items() if not table.empty}
    calibration = calibration_tables(tables)
    details |= calibration
    if calibrated := calibration_paragraph(calibration):
        paragraphs = [*paragraphs, calibrated]
    drawn = draw_figures(results, traces, "SIMULATED" if simulated else "")
    pictures = [Picture(each.name, each.formats["svg"], each.caption, each.width_mm) for each in drawn]
    printed = [*summaries, beside.table] if beside else summaries
    tex = latex(printed, note)
    flagged = details.get("flagged_trials")
    pages = participant_pages(tables, results, traces, flagged, note) if has_participants else ()
    comparisons = details["comparisons"]
    frames = {**details, "tests": comparisons[TESTS], "sensitivity": comparisons[SENSITIVITY]}
    shown = {
        name: (title, _titled(frames[name], results)) for name, title in TITLES.items() if name in frames
    }
    title = tables.protocol.title or tables.study
    warned = warnings(results, quality["flagged_trials"])
    marks = [each for each in (note, edited_note(tables), *warned) if each]
    html = page(
        title, _facts(results), marks, findings(results), summaries, beside, pictures, paragraphs, shown, tex
    )
    text = {
        "report.html": html,
        "results.tex": tex,
        "figures.tex": figures_tex(drawn, note),
        "results.md": markdown(printed, note, beside.notes if beside else ()),
        "methods.txt": "\n\n".join(paragraphs) + "\n",
        **{f"csv/{name}.csv": _csv(table) for name, table in details.items()},
        **{f"{FOLDER}/{name}": text for name, text in pages},
    }
    figures = {
        f"figures/{each.name}.{ending}": content for each in drawn for ending, content in each.formats.items()
    }
    return {**{name: content.encode() for name, content in text.items()}, **figures}


def _titled(frame: pd.DataFrame, results: StudyResults) -> pd.DataFrame:
    """Return a table with titles instead of names of conditions."""
    titled = frame.replace(dict.fromkeys(CONDITION_COLUMNS, results.titles))
    for name, title in results.titles.items() if "name" in titled else ():
        titled["name"] = titled["name"].str.replace(f"[T.{name}]", f": {title}", regex=False)
    return titled


def _facts(results: StudyResults) -> str:
    kind = "within-subject" if results.is_within else "between-subject"
    names = " · ".join(results.titles.values())
    runs = f"{len(results.runs)} runs of {results.participants} participants"
    status = (
        "with preregistered hypotheses"
        if results.hypotheses
        else "exploratory: no analysis was preregistered"
    )
    return f"{runs}, {kind}: {names} · {status} · haptigraph {__version__}, seed {results.plan.seed}"


def _csv(table: pd.DataFrame) -> str:
    return str(table.to_csv(index=False, lineterminator="\n"))
