"""Write all that a study comes to into one folder: page, figures, tables. The same bytes every time."""

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
from haptigraph.analysis.study.results import Plan, StudyResults, analyse
from haptigraph.analysis.study.results_table import latex, markdown, result_tables
from haptigraph.analysis.study.tables import StudyTables, read_tables
from haptigraph.analysis.study.traces import Traces, read_traces
from haptigraph.errors import BadInput
from haptigraph.recording.writer import Progress
from haptigraph.version import __version__

__all__ = ["Written", "write_report"]

GROUND = "The ground has the colours of the states."
CAPTIONS = {
    "state_times": "Time in each surgical state by condition. Boxes: quartiles; whiskers: 1.5 times that "
    f"range; points: participants. {GROUND}",
    "state_sequence": "Order of surgical states by condition: transitions per run; wider is more frequent.",
    "alignment": "Theta from entry to hit by condition: median and middle half of the participants.",
    "depth_theta": "Distance to the retina against theta by condition. Thin: runs; thick: median of the "
    f"participants at each moment of normalised time. {GROUND}",
    "learning": "Completion time and alignment over the trials, by the order of the conditions.",
}
TESTS = ["measure", "first", "second", "n_first", "n_second", "statistic", "p", "p_holm", "test", "effect"]
BESIDE = [
    *(
        "measure",
        "first",
        "second",
        "shapiro_p",
        "t_t",
        "t_df",
        "t_p",
        "t_difference",
        "t_low",
        "t_high",
        "t_d",
    ),
    *("power_observed", "power_detectable_d", "power_needed"),
]
TITLES = {
    "tests": "All tests",
    "beside": "Normality, t tests and power",
    "rank_test_variants": "Every variant of the rank tests",
    "omnibus": "Three or more conditions at once",
    "order_effects": "Order and learning (mixed models)",
    "sus_summary": "SUS by condition",
    "sus": "SUS by participant",
    "missing": "Missing data",
    "state_transitions": "Transitions between states",
}


class Written(Struct, frozen=True):
    """What was written."""

    page: Path
    files: list[Path]
    summary: str
    """The paper's table, in Markdown."""


def write_report(
    folder: str | Path,
    output: str | Path,
    plan: Plan | None = None,
    recordings: str | Path | None = None,
    progress: Progress | None = None,
) -> Written:
    """Analyse the tables of a study and write the report.

    Args:
        folder: Holds the tables.
        output: A folder, made if absent; files of the same name are replaced.
        plan: How to analyse.
        recordings: What the paths of the recordings are relative to; None: the folder of the tables.
        progress: Told how far it is.

    Raises:
        BadInput: If the tables, or a recording, make no sense; then nothing is written.
    """
    tables = read_tables(folder)
    results = analyse(tables, plan or Plan())
    traces = read_traces(results.runs, Path(recordings or folder), progress)
    simulated = tables.says_simulated or traces.is_simulated
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
    return Written(output / "report.html", [output / name for name in files], summary)


def _files(
    tables: StudyTables, results: StudyResults, traces: Traces, *, simulated: bool
) -> dict[str, bytes]:
    """Return every file by its name in the folder."""
    note = SIMULATED if simulated else ""
    told = result_tables(results)
    paragraphs = methods(tables, results, traces, simulated=simulated)
    details = detail_tables(results)
    drawn = _figures(results, traces, "SIMULATED" if simulated else "")
    pictures = [Picture(name, formats["svg"], CAPTIONS[name]) for name, formats in drawn.items()]
    tex = latex(told, note)
    comparisons = details["comparisons"]
    pages = {**details, "tests": comparisons[TESTS], "beside": comparisons[BESIDE]}
    shown = {name: (title, pages[name]) for name, title in TITLES.items() if name in pages}
    html = page(tables.title or tables.study, _facts(results), note, told, pictures, paragraphs, shown, tex)
    text = {
        "report.html": html,
        "results.tex": tex,
        "results.md": markdown(told, note),
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
