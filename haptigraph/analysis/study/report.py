"""Write the report of a study into one folder: page, figures, tables; equal data give equal bytes."""

from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure
from msgspec import Struct

from haptigraph.analysis.study.calibration import calibration_paragraph, calibration_tables
from haptigraph.analysis.study.data_quality import flagged_trials, quality_by_condition
from haptigraph.analysis.study.detail_tables import detail_tables
from haptigraph.analysis.study.figures.motion import alignment_figure, cone_figure, learning_figure
from haptigraph.analysis.study.figures.questionnaires import questionnaire_figure
from haptigraph.analysis.study.figures.states import box_figure, sequence_figure
from haptigraph.analysis.study.figures.style import rendered, styled
from haptigraph.analysis.study.methods import SIMULATED, methods, preregistered
from haptigraph.analysis.study.page import Picture, page
from haptigraph.analysis.study.results import AnalysisPlan, StudyResults, analyse
from haptigraph.analysis.study.results_table import hypothesis_table, latex, markdown, result_tables
from haptigraph.analysis.study.tables import StudyTables, read_tables
from haptigraph.analysis.study.traces import Traces, read_traces
from haptigraph.errors import BadInput
from haptigraph.recording.writer import Progress
from haptigraph.version import __version__

__all__ = ["WrittenReport", "write_report"]

COLORS = "Background colours indicate the states."
CAPTIONS = {
    "state_times": "Time in each surgical state by condition. Boxes: quartiles; whiskers: 1.5 times the "
    f"interquartile range; points: participants. {COLORS}",
    "state_sequence": "Order of surgical states by condition: transitions per run; width shows frequency.",
    "alignment": "Theta from entry to hit by condition: median and interquartile range of participants.",
    "depth_theta": "Distance to the retina against theta by condition. Thin: runs; thick: median of the "
    f"participants over normalised time. {COLORS}",
    "learning": "Completion time and alignment over the trials, by the order of the conditions.",
    "questionnaires": "Scores of questionnaires by condition. Boxes: quartiles; whiskers: 1.5 times the "
    "interquartile range; points: participants.",
}
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
]
SENSITIVITY = [
    "measure", "first", "second", "shapiro_p", "t_t", "t_df", "t_p", "t_difference", "t_low", "t_high", "t_d",
    "power_observed", "power_detectable_d", "power_needed",
]  # fmt: skip
CONDITION_COLUMNS = ("condition", "first", "second")
TITLES = {
    "tests": "All tests",
    "sensitivity": "Normality, t tests and power",
    "rank_test_variants": "All variants of the rank tests",
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
    """The preregistered hypotheses and the paper's table, in Markdown."""


def write_report(
    folder: str | Path,
    output: str | Path,
    plan: AnalysisPlan | None = None,
    recordings: str | Path | None = None,
    progress: Progress | None = None,
) -> WrittenReport:
    """Analyse the tables of a study and write the report.

    Args:
        folder: Contains the tables.
        output: A folder, created if missing; files of the same name are replaced.
        plan: The options of the analysis.
        recordings: The folder to which paths of recordings are relative; None: the folder of the tables.
        progress: Called with the progress.

    Raises:
        BadInput: If the tables or a recording are invalid; then nothing is written.
    """
    tables = read_tables(folder)
    results = analyse(tables, plan or AnalysisPlan())
    traces = read_traces(results.runs, Path(recordings or folder), progress)
    simulated = tables.is_simulated or traces.is_simulated
    files = _files(tables, results, traces, simulated=simulated)
    output = Path(output)
    for name, content in files.items():
        path = output / name
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        except OSError as error:
            raise BadInput(f"cannot be written ({error.strerror})", path) from None
    shown = [*hypothesis_table(results), *result_tables(results)[:1]]
    summary = f"{markdown(shown, SIMULATED if simulated else '')}\n{preregistered(results)}"
    return WrittenReport(output / "report.html", [output / name for name in files], summary)


def _files(
    tables: StudyTables, results: StudyResults, traces: Traces, *, simulated: bool
) -> dict[str, bytes]:
    """Return the content of every file by its path in the folder."""
    note = SIMULATED if simulated else ""
    summaries = [*hypothesis_table(results), *result_tables(results)]
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
    drawn = _figures(results, traces, "SIMULATED" if simulated else "")
    pictures = [Picture(name, formats["svg"], CAPTIONS[name]) for name, formats in drawn.items()]
    tex = latex(summaries, note)
    comparisons = details["comparisons"]
    frames = {**details, "tests": comparisons[TESTS], "sensitivity": comparisons[SENSITIVITY]}
    shown = {
        name: (title, _titled(frames[name], results)) for name, title in TITLES.items() if name in frames
    }
    title = tables.protocol.title or tables.study
    html = page(title, _facts(results), note, summaries, pictures, paragraphs, shown, tex)
    text = {
        "report.html": html,
        "results.tex": tex,
        "results.md": markdown(summaries, note),
        "methods.txt": "\n\n".join(paragraphs) + "\n",
        **{f"csv/{name}.csv": _csv(table) for name, table in details.items()},
    }
    figures = {
        f"figures/{name}.{ending}": content
        for name, formats in drawn.items()
        for ending, content in formats.items()
    }
    return {**{name: content.encode() for name, content in text.items()}, **figures}


def _figures(results: StudyResults, traces: Traces, note: str) -> dict[str, dict[str, bytes]]:
    with styled():
        drawn: dict[str, Figure | None] = {
            "state_times": box_figure(results, note),
            "state_sequence": sequence_figure(results, note),
            "alignment": alignment_figure(traces, results.titles, note),
            "depth_theta": cone_figure(traces, results.titles, note),
            "learning": learning_figure(results, note),
            "questionnaires": questionnaire_figure(results, note),
        }
    return {name: rendered(figure) for name, figure in drawn.items() if figure is not None}


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
