"""Runs, steps, conclusions and reports as HTML tables, for notebooks. No script, no style sheet."""

import base64
from collections.abc import Callable, Iterable, Mapping
from html import escape

from haptigraph.assemble import parse_procedure
from haptigraph.display import view
from haptigraph.errors import MissingExtra
from haptigraph.messages import Conclusion, Step
from haptigraph.recording.header import losses_sentence
from haptigraph.recording.reader import RunReader
from haptigraph.run_report import RunReport

__all__ = ["conclusion_html", "report_html", "run_html", "step_html"]


def _table_html(rows: Iterable[tuple[str, object]], title: str) -> str:
    """Return a table with a name and a value in each row; rows without value are left out."""
    cells = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th>'
        f'<td style="text-align:left">{escape(str(value))}</td></tr>'
        for name, value in rows
        if value not in ("", None)
    )
    return f'<table><caption style="text-align:left"><b>{escape(title)}</b></caption>{cells}</table>'


def conclusion_html(conclusion: Conclusion) -> str:
    """Return a conclusion as a table."""
    return _table_html(_conclusion_rows(conclusion), conclusion.state)


def step_html(step: Step) -> str:
    """Return a step as a table, above a drawing of its scene graph."""
    certainty = step.observation.certainty
    sds = [] if certainty is None else [("confidence", f"{certainty.confidence:.2f}")]
    if certainty is not None and certainty.tip_sd_mm is not None:
        sds.append(("standard deviation of the tip", f"{certainty.tip_sd_mm:.3f} mm"))
    rows = [
        ("image", step.index),
        ("time on the run's clock", f"{step.stamp_ns / 1e9:.3f} s"),
        *_conclusion_rows(step.conclusion),
        ("plays", step.command.pattern.name),
        *((name, f"{value:.3g}") for name, value in step.graph.measures.items()),
        *sds,
        ("faults", "; ".join(map(str, step.faults))),
    ]
    table = _table_html(rows, step.conclusion.state)
    return table + _or_missing(lambda: str(view("SceneGraph", step.graph))) if step.graph.nodes else table


def report_html(report: RunReport) -> str:
    """Return the technical statistics of a run as tables: counts, and the durations of its stages."""
    rows = [
        ("ended", report.ended),
        ("steps", report.steps),
        ("duration", f"{report.duration_s:.1f} s"),
        ("rate", f"{report.rate_hz:.0f} steps/s"),
        ("overruns", report.overruns),
        ("skipped images", report.skipped),
        ("dropped items", report.dropped),
        ("faults", _counts(report.faults)),
        ("assumed", ", ".join(report.assumed)),
        ("haptic output", "off" if report.is_output_off else ""),
        ("incomplete", report.incomplete),
        ("force", report.force),
    ]
    stages = [
        (name, f"p50 {times.percentile_ms(50):.2f} ms, p99 {times.percentile_ms(99):.2f} ms")
        for name, times in report.stages.items()
        if report.steps
    ]
    return _table_html(rows, "run") + _table_html(stages, "durations")


def run_html(run: RunReader) -> str:
    """Return what a recording is, as a table, above its timeline.

    Raises:
        BadInput: If it is damaged.
    """
    info, state = run.info, "interrupted"
    if run.is_whole or run.is_being_written:
        state = "complete" if run.is_whole else "still being written"
    rows = [
        ("source", info.source),
        ("started", info.started_utc),
        ("steps", len(run)),
        ("procedure", parse_procedure(info.procedure, f"procedure in {run.path}").name),
        ("participant", info.participant),
        ("trial", info.trial),
        ("recording", state),
        ("lost", losses_sentence(run.losses) if run.losses else ""),
        ("haptigraph", info.version),
    ]
    table = _table_html(rows, run.path.name)
    if not len(run):
        return table
    return table + _or_missing(lambda: _figure_html(run))


def _or_missing(drawn: Callable[[], str]) -> str:
    """Return a drawing, or the extra that it needs."""
    try:
        return drawn()
    except MissingExtra as missing:
        return f"<p>{escape(str(missing))}</p>"


def _figure_html(run: RunReader) -> str:
    picture = base64.b64encode(view("run figure", run)._repr_png_()).decode()
    alt = "states, measures and haptic output over time"
    return f'<img alt="{alt}" src="data:image/png;base64,{picture}">'


def _conclusion_rows(conclusion: Conclusion) -> list[tuple[str, object]]:
    return [
        ("because", conclusion.because),
        ("priority", conclusion.priority),
        ("feels", conclusion.feel),
        ("evidence", ", ".join(map(str, conclusion.evidence))),
        ("force fields", ", ".join(conclusion.forces)),
    ]


def _counts(faults: Mapping[str, int]) -> str:
    return "; ".join(f"{fault} ({count} times)" for fault, count in faults.items()) or "none"
