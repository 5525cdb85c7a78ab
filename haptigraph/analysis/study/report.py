"""Write the report of a study into one folder: page, figures, tables; equal data give equal bytes."""

from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure
from msgspec import Struct

from haptigraph.analysis.study.detail_tables import detail_tables
from haptigraph.analysis.study.figures.motion import alignment_figure, cone_figure, learning_figure
from haptigraph.analysis.study.figures.states import box_figure, sequence_figure
from haptigraph.analysis.study.figures.style import rendered, styled
from haptigraph.analysis.study.methods import SIMULATED, methods
from haptigraph.analysis.study.page import Picture, page
from haptigraph.analysis.study.quantities import words
from haptigraph.analysis.study.results import AnalysisPlan, StudyResults, analyse
from haptigraph.analysis.study.results_table import latex, markdown, result_tables
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
}
TESTS = [
    "measure",
    "first",
    "second",
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
TITLES = {
    "tests": "All tests",
    "sensitivity": "Normality, t tests and power",
    "rank_test_variants": "All variants of the rank tests",
    "equivalence": "Equivalence (two one-sided tests)",
    "hit_rate": "Hit rate",
    "worst_rank": "Completion time with runs without a hit ranked last",
    "omnibus": "Omnibus tests of three or more conditions",
    "order_effects": "Order and learning (mixed models)",
    "sus_summary": "SUS by condition",
    "sus": "SUS by participant",
    "missing": "Missing data",
    "state_transitions": "Transitions between states",
}


class WrittenReport(Struct, frozen=True):
    """The files of a report."""

    page: Path
    files: list[Path]
    summary: str
    """The paper's table, in Markdown."""


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
    summary = markdown(result_tables(results)[:1], SIMULATED if simulated else "")
    return WrittenReport(output / "report.html", [output / name for name in files], summary)


def _files(
    tables: StudyTables, results: StudyResults, traces: Traces, *, simulated: bool
) -> dict[str, bytes]:
    """Return the content of every file by its path in the folder."""
    note = SIMULATED if simulated else ""
    summaries = result_tables(results)
    paragraphs = methods(tables, results, traces, simulated=simulated)
    details = detail_tables(results)
    drawn = _figures(results, traces, "SIMULATED" if simulated else "")
    pictures = [Picture(name, formats["svg"], CAPTIONS[name]) for name, formats in drawn.items()]
    tex = latex(summaries, note)
    comparisons = details["comparisons"]
    frames = {**details, "tests": comparisons[TESTS], "sensitivity": comparisons[SENSITIVITY]}
    shown = {name: (title, frames[name]) for name, title in TITLES.items() if name in frames}
    title = tables.title or tables.study
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
            "alignment": alignment_figure(traces, results.conditions, note),
            "depth_theta": cone_figure(traces, results.conditions, note),
            "learning": learning_figure(results, note),
        }
    return {name: rendered(figure) for name, figure in drawn.items() if figure is not None}


def _facts(results: StudyResults) -> str:
    kind = "within-subject" if results.is_within else "between-subject"
    names = " · ".join(words(name) for name in results.conditions)
    runs = f"{len(results.runs)} runs of {results.participants} participants"
    return f"{runs}, {kind}: {names} · haptigraph {__version__}, seed {results.plan.seed}"


def _csv(table: pd.DataFrame) -> str:
    return str(table.to_csv(index=False, lineterminator="\n"))
