"""The figures of the paper, of any recorded run: processing sequence, views of a moment, timeline."""

from collections.abc import Container
from pathlib import Path
from typing import Literal, TypeAlias

from haptigraph.analysis.metrics.replay import replay_steps
from haptigraph.analysis.paper.pipeline import pipeline_figure
from haptigraph.analysis.paper.stages import read_stages
from haptigraph.analysis.paper.views import views_figure
from haptigraph.analysis.plots.paper import COLORS, WIDTH_IN, check_new, save, styled
from haptigraph.analysis.plots.series import Series, read_series, series_of
from haptigraph.analysis.plots.timeline import draw_timeline
from haptigraph.assemble import load_procedure
from haptigraph.errors import BadInput
from haptigraph.figures import Figure
from haptigraph.messages import Image, Step
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress
from haptigraph.registration.camera import Registration
from haptigraph.registration.loading import parse_registration
from haptigraph.sources.naming import is_simulated

__all__ = ["KINDS", "Kind", "paper_figure"]

Kind: TypeAlias = Literal["pipeline", "views", "timeline"]
KINDS: tuple[Kind, ...] = ("pipeline", "views", "timeline")
NEEDLE = {"needle_tip", "needle_line"}
MEANINGS = ("alarm", "success", "guidance", "neutral")
"""Kinds of states, the one that shows most first."""


def paper_figure(
    path: str | Path,
    kind: Kind,
    output: str | Path,
    at_s: float | None = None,
    procedure: str | None = None,
    progress: Progress | None = None,
) -> None:
    """Draw a figure of one recorded run to a new PDF, SVG or PNG file.

    Args:
        path: The recording.
        kind: Which figure.
        output: The file to write.
        at_s: Time since the first step; None: the middle of the longest alarm, or else of what shows most.
        procedure: Another procedure, whose states and haptic output a timeline shows too; None: none.
        progress: Called with the progress.

    Raises:
        BadInput: If the recording does not have what the figure shows, or the file cannot be written.
    """
    target, reader = check_new(output), RunReader(path)
    series = read_series(reader)
    with styled():
        if kind == "timeline":
            if at_s is not None:
                raise BadInput("--at goes with --kind pipeline and views; a timeline shows the whole run")
            other = _replayed(reader, procedure, progress) if procedure is not None else None
            figure = Figure(figsize=(WIDTH_IN, 5.2 if other is None else 7.2), layout="constrained")
            draw_timeline(figure, series, other, _name_of(procedure, series, other))
        elif procedure is not None:
            raise BadInput("--procedure goes with --kind timeline; the other figures show what was recorded")
        else:
            figure = _moment_figure(reader, series, kind, at_s, progress)
        if is_simulated(reader.info.source):
            note = figure.text(0.002, 0.004, "simulated", ha="left", fontsize=5, color=COLORS["grey"])
            note.set_in_layout(False)
        save(figure, target)


def _name_of(given: str | None, series: Series, other: Series | None) -> str:
    """Return the name of another procedure; that of its file if the recorded one has the same name."""
    if given is None or other is None:
        return ""
    return other.procedure.name if other.procedure.name != series.procedure.name else Path(given).name


def _replayed(reader: RunReader, name: str, progress: Progress | None) -> Series:
    """Return what another procedure makes of the same images."""
    procedure, steps = load_procedure(name), list[Step]()
    total = reader.count()[0] if progress is not None else 0
    for _, step in replay_steps(reader, procedure):
        steps.append(step)
        if progress is not None:
            progress("replaying", len(steps), total)
    return series_of(steps, procedure)


def _moment_figure(
    reader: RunReader, series: Series, kind: Kind, at_s: float | None, progress: Progress | None
) -> Figure:
    registration = parse_registration(reader.info.registration, f"registration in {reader.path}")
    schema = {entity.name for entity in series.procedure.schema.entities}
    if not isinstance(registration, Registration) or not schema >= NEEDLE:
        raise BadInput(
            f"--kind {kind} shows runs with a camera and a needle; this is another one", reader.path
        )
    number = (
        _number_at(series, at_s, reader.path) if at_s is not None else _most_relevant(series, reader.path)
    )
    if kind == "pipeline":
        return pipeline_figure(read_stages(reader, registration, number, progress), registration)
    image = _image(reader, number)
    return views_figure(series, number, image, registration)


def _number_at(series: Series, at_s: float, path: Path) -> int:
    """Return the step that was current at a time."""
    if not 0 <= at_s <= series.time_s[-1]:
        raise BadInput(f"has no step at {at_s:g} s; valid: 0 to {series.time_s[-1]:.2f} s", path)
    return sum(time_s <= at_s + 1e-9 for time_s in series.time_s) - 1


def _most_relevant(series: Series, path: Path) -> int:
    """Return the middle of the longest interval with a tip, of the kind of state that shows most."""
    kinds = series.procedure.kinds
    for meaning in MEANINGS:
        spans = [
            (end - start, (start + end) // 2)
            for start, end, state in series.intervals()
            if kinds.get(state) == meaning
            and "needle_tip" in series.steps[(start + end) // 2].observation.found
        ]
        if spans:
            return max(spans)[1]
    raise BadInput("has no step with a needle whose tip is visible; give --at", path)


def _image(reader: RunReader, number: int) -> Image:
    wanted: Container[int] = {number}
    for place, (capture, _) in enumerate(reader.records(images=wanted)):
        if place == number and capture.image is not None:
            return capture.image
    raise BadInput(f"has no image of step {number}; choose another with --at", reader.path)
