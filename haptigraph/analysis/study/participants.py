"""A page per participant, for the researcher: trials, measures, time in states, scores, and traces."""

from collections.abc import Iterator
from html import escape
from urllib.parse import quote

import pandas as pd

from haptigraph.analysis.study.detail_tables import graded
from haptigraph.analysis.study.figures.learning import session_places
from haptigraph.analysis.study.figures.person import person_figure
from haptigraph.analysis.study.figures.style import TWO_COLUMNS_MM, rendered, styled
from haptigraph.analysis.study.page import Picture, document, figure_html, table_html
from haptigraph.analysis.study.quantities import QUANTITIES, state_of, state_quantities, words
from haptigraph.analysis.study.results import StudyResults
from haptigraph.analysis.study.results_table import NONE, Table, number
from haptigraph.analysis.study.tables import StudyTables
from haptigraph.analysis.study.traces import Traces

__all__ = ["FOLDER", "participant_pages"]

FOLDER = "participants"
KEYS = ["position", "phase", "block", "trial", "attempt"]
CAPTION = (
    "Theta and distance to the retina over time, a column per run, on the scales of the whole study; a run "
    "ends with the target hit or the timeout. Background colours indicate the states."
)


def participant_pages(
    tables: StudyTables, results: StudyResults, traces: Traces, note: str
) -> Iterator[tuple[str, str]]:
    """Yield the name of a file and its page for everyone who has not withdrawn.

    Args:
        tables: The study's tables.
        results: Their analysis.
        traces: Of the analysed runs.
        note: A prominent note at the top, such as that it was simulated; may be empty.
    """
    runs = session_places(results.runs.rename_axis("run").reset_index())
    for name in sorted(set(tables.trials["participant"]) - set(tables.withdrawn)):
        attempts = tables.trials[tables.trials["participant"] == name]
        page = _page(name, attempts, runs[runs["participant"] == name], tables, results, traces, note)
        yield f"{quote(name, safe='')}.html", page


def _page(
    name: str,
    attempts: pd.DataFrame,
    runs: pd.DataFrame,
    tables: StudyTables,
    results: StudyResults,
    traces: Traces,
    note: str,
) -> str:
    title = f"{name}: {tables.protocol.title or tables.study}"
    scores = results.sus[results.sus["participant"] == name] if not results.sus.empty else results.sus
    parts = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="mark">{escape(note)}</p>' if note else "",
        f"<p class='quiet'>{len(runs)} of {len(attempts)} attempts count. This page is about one person: "
        "treat it like the data, and renew the report after an erasure.</p>",
        "<h2>Trials</h2>",
        table_html(_trials(attempts, runs, results.titles)),
        table_html(_measures(runs, results)) if len(runs) else "",
        "<h2>Traces</h2>" if len(runs) else "",
        *_traces(runs, results, traces, note),
        "" if scores.empty else f"<h2>Questionnaires</h2>{table_html(_scores(scores, results))}",
    ]
    return document(title, parts)


def _trials(attempts: pd.DataFrame, runs: pd.DataFrame, titles: dict[str, str]) -> Table:
    """Return all attempts; those that count have the number of their run."""
    keys = [key for key in KEYS if key in attempts]
    numbers = {
        key: str(number) for number, key in enumerate(runs[keys].itertuples(index=False, name=None), 1)
    }
    rows = [
        [
            words(str(row["phase"])),
            numbers.get(tuple(row[key] for key in keys), NONE),
            titles.get(str(row["condition"])) or _text(row["condition"]),
            *(_text(row.get(key)) for key in ("target", "attempt", "outcome")),
        ]
        for row in attempts.sort_values(keys, na_position="first").to_dict("records")
    ]
    head = ["Phase", "Run", "Condition", "Target", "Attempt", "Outcome"]
    return Table("All attempts; those with a number under “Run” count in the analysis.", head, rows)


def _text(value: object) -> str:
    if isinstance(value, str):
        return words(value)
    return f"{value:g}" if isinstance(value, float) and value == value else NONE


def _measures(runs: pd.DataFrame, results: StudyResults) -> Table:
    """Return the measures and the times in states that the analysis uses, a column per run."""
    quantities = [each for each in [*QUANTITIES, *state_quantities(runs.columns)] if each.name in runs]
    rows = [
        [each.title, *(number(value, each.decimals) for value in runs[each.name])]
        for each in quantities
        if each.name in results.values and state_of(each.name) not in results.idle
    ]
    head = ["Run", *(str(place) for place in range(1, len(runs) + 1))]
    return Table("Measures of the runs; states that nobody was in are left out.", head, rows)


def _traces(runs: pd.DataFrame, results: StudyResults, traces: Traces, note: str) -> Iterator[str]:
    if runs.empty:
        return
    names = {
        int(row["run"]): f"{place} {results.title_of(str(row['condition']))}, {row['outcome']}"
        for place, row in enumerate(runs.to_dict("records"), 1)
    }
    by_run = {trace.run: trace for trace in traces.runs}
    shown = [by_run[run] for run in names if run in by_run]
    if shown:
        with styled():
            figure = person_figure(traces, shown, names, note)
        svg = rendered(figure, ("svg",))["svg"]
        yield figure_html(Picture("traces", svg, CAPTION, TWO_COLUMNS_MM))
    if len(shown) < len(names):
        yield f"<p>Without a readable recording: {len(names) - len(shown)} of {len(names)} runs.</p>"


def _scores(scores: pd.DataFrame, results: StudyResults) -> Table:
    rows = [
        [
            results.titles.get(str(row["condition"])) or _text(row["condition"]),
            number(row["sus"], 1),
            str(row["grade"]),
            str(row["adjective"]),
        ]
        for row in graded(scores).to_dict("records")
    ]
    return Table(
        "System Usability Scale; an incomplete sheet has no score.",
        ["Condition", "SUS", "Grade", "Adjective"],
        rows,
    )
