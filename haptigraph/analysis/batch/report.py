"""The report of a batch: report.html, recordings.csv with a row each, and lines for a terminal."""

import csv
from collections.abc import Iterator, Mapping
from contextlib import closing
from html import escape
from pathlib import Path
from typing import Any

from haptigraph.analysis.batch.batch import Batch, open_results
from haptigraph.analysis.batch.figures import paired_bars, share_bars
from haptigraph.analysis.batch.results import Row
from haptigraph.analysis.batch.summary import MAX_LISTED, Moment, Result, Totals
from haptigraph.analysis.evaluation.tip_scores import spread
from haptigraph.analysis.metrics.comparison import identical_line
from haptigraph.analysis.metrics.page_address import moment_address, page_command, page_procedure
from haptigraph.analysis.words import counted
from haptigraph.files import write_files

__all__ = ["write_report"]

MEASURED = ("_mm", "_deg")
MAX_PRINTED = 10  # recordings that were passed over
STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; }
td, th { padding: .2rem .8rem .2rem 0; text-align: left; vertical-align: top; }
td.number { text-align: right; font-variant-numeric: tabular-nums; } .quiet { color: #555; }
.each td:not(:nth-child(6)) { white-space: nowrap; }
h2 { margin-top: 2rem; } svg { max-width: 100%; height: auto; }
"""
TITLES = {
    "gained": "Alarms gained",
    "lost": "Alarms lost",
}
HEAD = (
    *("recording", "states differ", "haptic output differs", "steps", "first at", "first change"),
    *("state changes", "alarms"),
)
ALARMS = (
    "An alarm is gained if it is in the replayed run, and none of its steps is one of an alarm in the "
    "recorded run; lost, the other way round. State changes are counted from the start of a run to its end."
)


def write_report(batch: Batch, page: str) -> list[str]:
    """Write the report of a batch's results; return its summary as lines of text.

    Args:
        batch: What was done.
        page: Address of the server of the recordings page, for links.

    Raises:
        BadInput: If the results are those of another batch.
    """
    totals = Totals(batch.kind)
    with closing(open_results(batch)) as results:
        columns = _columns(results.rows())
        with (batch.output / "recordings.csv").open("w", newline="", encoding="utf-8") as file:
            table = csv.DictWriter(file, columns, lineterminator="\n")
            table.writeheader()
            for row in results.rows():
                totals.add(row)
                table.writerow({"recording": row.recording, "problem": row.problem, **_flat(row.result)})
    lines = list(_lines(totals))
    write_files([batch.output / "report.html"], [_html(batch, totals, lines, page).encode()])
    more = totals.passed_over - MAX_PRINTED
    return [
        *lines,
        *(f"passed over: {name}: {why}" for name, why in totals.problems[:MAX_PRINTED]),
        *([f"and {more} more: recordings.csv"] if more > 0 else []),
    ]


def _columns(rows: Iterator[Row]) -> list[str]:
    names = dict.fromkeys(["recording", "problem"])
    for row in rows:
        names |= dict.fromkeys(_flat(row.result))
    return list(names)


def _flat(result: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return a result as columns: of measurements median and 95th percentile; other lists are counted."""
    flat: dict[str, Any] = {}
    for name, value in result.items():
        if isinstance(value, list) and name.endswith(MEASURED):
            value = spread(value)
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{name}.")
        else:
            flat[prefix + name] = len(value) if isinstance(value, list) else value
    return flat


def _lines(totals: Totals) -> Iterator[str]:
    sums = totals.sums
    yield f"{counted(totals.recordings, 'recording')}, {totals.passed_over} passed over"
    if totals.kind == "replay":
        yield (
            f"states differ for {sums['states_differ_s']:.2f} s in {sums['states_differ']} of "
            f"{sums['steps']} steps, haptic output for {sums['haptics_differ_s']:.2f} s in "
            f"{sums['haptics_differ']}"
        )
        yield (
            f"changed: {counted(totals.changed, 'recording')}; "
            f"state changes: {totals.state_changes[0]} recorded, {totals.state_changes[1]} replayed; "
            f"alarms: {totals.gained} gained, {totals.lost} lost; "
            f"hits: {totals.hits_gained} gained, {totals.hits_lost} lost"
        )
        yield identical_line(int(sums["identical"]), int(sums["steps"]))
    for perceiver, tips in totals.tips.items():
        reported = f"{tips['tips']} of {tips['images']} images"
        yield f"{perceiver}: tip reported in {reported}, and {tips['false_tips']} false ones"
    for name in totals.values:
        count, median, low, high = totals.spread(name)
        yield f"{name:38} n {count:6}  median {median:10.4g}  90 % within {low:.4g} to {high:.4g}"


def _html(batch: Batch, totals: Totals, lines: list[str], page: str) -> str:
    title = f"batch {batch.kind}: {batch.folder}"
    applied = f" under <strong>{escape(batch.procedure)}</strong>" if batch.procedure else ""
    about = batch.about()
    parts = [
        f"<h1>{escape(title)}</h1>",
        f"<p>All recordings below {escape(about['folder'])}{applied}, by haptigraph {about['haptigraph']}. "
        "Research software, not a medical device.</p>",
        "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>",
        f"<p class='quiet'>Processor time of the workers: {totals.cpu_s:.0f} s. Links to moments need "
        f"<code>{escape(page_command(batch.folder))}</code>.</p>",
    ]
    if batch.kind == "replay":
        parts += _replay_parts(batch, totals, page)
    if totals.problems:
        rows = "".join(
            f"<tr><td>{escape(name)}</td><td>{escape(why)}</td></tr>" for name, why in totals.problems
        )
        parts.append(f"<h2>Passed over</h2><table>{rows}</table>")
        parts.append(_left_out(totals.passed_over))
    return (
        f'<!doctype html>\n<html lang="en">\n<meta charset="utf-8">\n<title>{escape(title)}</title>\n'
        f"<style>{STYLE}</style>\n" + "\n".join(parts) + "\n</html>\n"
    )


def _replay_parts(batch: Batch, totals: Totals, page: str) -> Iterator[str]:
    names = ("recorded", batch.procedure or "replayed")
    yield "<h2>Time in each state</h2>" + paired_bars(totals.state_s, names, "s")
    yield "<h2>Steps of each pattern</h2>" + paired_bars(totals.pattern_steps, names, "steps")
    yield "<h2>How much of a recording changes</h2>" + share_bars(totals.shares)
    yield f"<p class='quiet'>{ALARMS}</p>"
    known = page_procedure(batch.procedure, batch.folder)
    if batch.procedure and not known:
        yield (
            f"<p class='quiet'>To compare on the page, copy {escape(Path(batch.procedure).name)} into the "
            "folder of recordings, and run this batch again: it renews the links.</p>"
        )
    listed = [*totals.listed[0], *totals.listed[1]][:MAX_LISTED]
    head = "".join(f"<th>{each}</th>" for each in HEAD)
    compared = "".join(_compared(result, known, page) for result in listed)
    yield f"<h2>Recordings that change: {totals.changed}</h2>"
    yield f"<table class='each'><tr>{head}</tr>{compared}</table>"
    yield _left_out(totals.recordings)
    counts = {"gained": totals.gained, "lost": totals.lost}
    for kind, moments in totals.moments.items():
        rows = "".join(_moment(moment, known, page) for moment in moments)
        yield f"<h2>{TITLES[kind]}: {counts[kind]}</h2><table>{rows}</table>{_left_out(counts[kind])}"


def _moment(moment: Moment, procedure: str, page: str) -> str:
    name, step, time_s, what = moment
    address = moment_address(name, step=step, procedure=procedure, page=page)
    return (
        f'<tr><td><a href="{escape(address)}">{escape(name)}</a></td><td class="number">{time_s:.2f} s</td>'
        f"<td>{escape(what.replace('_', ' '))}</td></tr>"
    )


def _compared(listed: Result, procedure: str, page: str) -> str:
    """Return the row of one recording."""
    name, result = listed
    address = moment_address(name, step=result["first_step"], procedure=procedure, page=page)
    first_s, first = result["first_haptics_s"], "haptic output alone"
    for change in result["changes"][:1]:
        first_s, first = change["time_s"], f"{change['replayed']} instead of {change['recorded']}"
    alarms = [f"{len(result[f'alarms_{kind}'])} {kind}" for kind in TITLES if result[f"alarms_{kind}"]]
    cells = (
        f"{result['states_differ_s']:.2f} s",
        f"{result['haptics_differ_s']:.2f} s",
        f"{result['states_differ']} of {result['steps']}",
        *(("", "") if first_s is None else (f"{first_s:.2f} s", first.replace("_", " "))),
        f"{result['recorded']['state_changes']} → {result['replayed']['state_changes']}",
        ", ".join(alarms),
    )
    row = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
    return f'<tr><td><a href="{escape(address)}">{escape(name)}</a></td>{row}</tr>'


def _left_out(count: int) -> str:
    more = count - MAX_LISTED
    return f"<p class='quiet'>and {more} more: recordings.csv</p>" if more > 0 else ""
