"""A page per participant, for the researcher: trials, measures, time in states, scores, and traces."""

from collections.abc import Iterator, Sequence
from html import escape
from urllib.parse import quote

import pandas as pd

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
QUALITY = {
    "images_per_s": ("Images per Second", 1),
    "late_images_fraction": ("Late Images (share)", 3),
    "skipped_images": ("Skipped Images", 0),
    "unseen_fraction": ("Tip Not Visible (share of time)", 3),
    "long_gaps": ("Gaps of the Tip above 0.5 s", 0),
    "longest_gap_s": ("Longest Gap of the Tip (s)", 2),
}
"""Label and decimals of the measures of data quality, which older recordings lack."""
CAPTION = (
    "Theta and distance to the retina over time, a column per run, on the scales of the whole study; a run "
    "ends with the target hit or the timeout. Background colours indicate the states."
)


def participant_pages(
    tables: StudyTables,
    results: StudyResults,
    traces: Traces,
    flagged: pd.DataFrame | None,
    note: str,
) -> Iterator[tuple[str, str]]:
    """Yield the name of a file and its page for everyone who has not withdrawn.

    Args:
        tables: The study's tables.
        results: Their analysis.
        traces: Of the analysed runs.
        flagged: The runs of poor data quality: participant, condition, trial, and the problem; None: none.
        note: A prominent note at the top, such as that it was simulated; may be empty.
    """
    runs = session_places(results.runs.rename_axis("run").reset_index())
    for name in sorted(set(tables.trials["participant"]) - set(tables.withdrawn)):
        attempts = tables.trials[tables.trials["participant"] == name]
        mine = runs[runs["participant"] == name]
        title = f"{name}: {tables.protocol.title or tables.study}"
        problems = [] if flagged is None else _flags(flagged[flagged["participant"] == name], results)
        page = _page(title, attempts, mine, results, problems, _traces(mine, results, traces, note), note)
        yield f"{quote(name, safe='')}.html", page


def _page(
    title: str,
    attempts: pd.DataFrame,
    runs: pd.DataFrame,
    results: StudyResults,
    problems: Sequence[str],
    traces: Iterator[str],
    note: str,
) -> str:
    name = attempts["participant"].iloc[0]
    scores = _scores(name, results)
    parts = [
        f"<h1>{escape(title)}</h1>",
        f'<p class="mark">{escape(note)}</p>' if note else "",
        f"<p class='quiet'>{len(runs)} of {len(attempts)} attempts count. This page is about one person: "
        "treat it like the data, and renew the report after an erasure.</p>",
        "<h2>Trials</h2>",
        table_html(_trials(attempts, runs, results.titles)),
        table_html(_measures(runs, results)) if len(runs) else "",
        *(f"<p>{escape(problem)}</p>" for problem in problems),
        "<h2>Traces</h2>" if len(runs) else "",
        *traces,
        f"<h2>Questionnaires</h2>{table_html(scores)}" if scores.rows else "",
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
    rows += [
        [label, *(number(value, decimals) for value in runs[name])]
        for name, (label, decimals) in QUALITY.items()
        if name in runs
    ]
    head = ["Run", *(str(place) for place in range(1, len(runs) + 1))]
    return Table("Measures of the runs; states that nobody was in are left out.", head, rows)


def _flags(flagged: pd.DataFrame, results: StudyResults) -> list[str]:
    """Return what is beyond the protocol's thresholds of data quality, a sentence per run."""
    return [
        f"Flagged: {results.title_of(str(row['condition']))}, trial {row['trial']:g}: {row['problem']}."
        for row in flagged.to_dict("records")
    ]


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


def _scores(name: str, results: StudyResults) -> Table:
    rows = []
    for questionnaire in results.questionnaires:
        sheets = results.scores[questionnaire.name]
        for sheet in sheets[sheets["participant"] == name].to_dict("records"):
            about = results.titles.get(str(sheet["condition"])) or _text(sheet["condition"])
            for scale in questionnaire.scales:
                label = (
                    results.quantities[scale.name].label if scale.name in results.quantities else scale.name
                )
                rows.append([label, about, number(sheet[scale.name], 1)])
    return Table("Scores; an incomplete sheet has none.", ["Score", "Condition", "Value"], rows)
