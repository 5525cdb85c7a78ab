"""Figures of recorded runs: images, scene graphs, states, measures and haptic output over time."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from msgspec import Struct

from haptigraph.analysis.plots.drawing import draw_graph, draw_overlay
from haptigraph.assemble import parse_procedure
from haptigraph.errors import BadInput
from haptigraph.graph import Schema
from haptigraph.haptics.pattern import amplitude_at
from haptigraph.inference.colors import Paint, palette
from haptigraph.messages import UNKNOWN, Image, Step
from haptigraph.perception.eye_view import IoctView
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.registered import BaseRegistration

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["run_figure"]

DISTANCES = ("distance_to_retina_mm", "distance_to_target_mm", "radial_mm")
DEPTHS = ("above_retina_um", "above_target_um", "above_rpe_um")  # of B-scans
DISTANCE_COLORS = ("#444444", "#3a9d5d", "#8a5fb0")
MAX_MOMENTS = 5
HAPTICS_COLOR = "#b5482a"


class _Series(Struct):
    """A run as columns."""

    time_s: list[float]
    steps: list[Step]
    schema: Schema
    paints: dict[str, Paint]

    def bounds(self, measure: str) -> list[float]:
        """Return the thresholds that the procedure sets on a measure, smallest first."""
        relations = [other for other in self.schema.relations if self.schema.measure_name(other) == measure]
        bounds = {
            bound
            for other in relations
            for bound in (other.at_most, other.below, other.at_least, other.above)
        }
        return sorted(bound for bound in bounds if bound is not None)


def run_figure(path: str | Path, output: str | Path, progress: Progress | None = None) -> None:
    """Draw one recorded run to a PNG, SVG or PDF file.

    Args:
        path: The recording.
        output: The file to write.
        progress: Called with the progress.

    Raises:
        BadInput: If the recording cannot be read.
    """
    report = progress or (lambda what, done, total: None)
    reader = RunReader(path)
    report("drawing", 0, 3)
    series = _read_series(reader)
    report("drawing", 1, 3)
    moments = _moments(series)
    records = reader.records(images=set(moments))
    images = {number: capture.image for number, (capture, _) in enumerate(records) if number in moments}
    report("drawing", 2, 3)
    registration = parse_registration(reader.info.registration, f"registration in {path}")
    figure = Figure(figsize=(14, 11), layout="constrained")
    top, bottom = np.ravel(np.asarray(figure.subfigures(2, 1, height_ratios=(0.95, 1))))
    if moments:
        _draw_moments(top, series, moments, images, registration)
    _draw_timeline(bottom, series)
    simulated = " (simulated)" if reader.info.source.startswith("phantom:") else ""
    who = f" · participant {reader.info.participant}" if reader.info.participant else ""
    figure.suptitle(f"haptigraph {reader.info.version} · {reader.info.source}{simulated}{who}")
    try:
        figure.savefig(output, dpi=110)
    except OSError as error:  # that of a full disk does not name the file
        raise BadInput(f"cannot be written ({error.strerror})", output) from None
    report("drawing", 3, 3)


def _read_series(reader: RunReader) -> _Series:
    steps = [step for _, step in reader.records(images=())]
    if not steps:
        raise BadInput("has no complete step to draw", reader.path)
    procedure = parse_procedure(reader.info.procedure, f"procedure in {reader.path}")
    time_s = [(step.stamp_ns - steps[0].stamp_ns) / 1e9 for step in steps]
    return _Series(time_s, steps, procedure.schema, palette(procedure))


def _intervals(series: _Series) -> list[tuple[int, int, str]]:
    """Return (first, end, state) of every interval of one state."""
    states = [step.conclusion.state for step in series.steps]
    starts = [row for row in range(len(states)) if row == 0 or states[row] != states[row - 1]]
    return [
        (start, end, states[start]) for start, end in zip(starts, [*starts[1:], len(states)], strict=True)
    ]


def _moments(series: _Series) -> list[int]:
    """Choose the steps to show: the middle of the longest interval of each state, in order of time."""
    longest: dict[str, tuple[int, int]] = {}
    for start, end, state in _intervals(series):
        if state != UNKNOWN and end - start > longest.get(state, (0, 0))[1] - longest.get(state, (0, 0))[0]:
            longest[state] = start, end
    rarest_first = sorted(longest.values(), key=lambda interval: interval[1] - interval[0])
    return sorted((start + end) // 2 for start, end in rarest_first[:MAX_MOMENTS])


def _draw_moments(
    figure: "Figure",
    series: _Series,
    moments: list[int],
    images: dict[int, Image | None],
    registration: BaseRegistration,
) -> None:
    axes = figure.subplots(2, len(moments), squeeze=False, height_ratios=(1.25, 1))
    view = IoctView(registration)
    for column, number in enumerate(moments):
        step, picture, graph = series.steps[number], axes[0, column], axes[1, column]
        image, paint = images.get(number), series.paints[step.conclusion.state]
        if image is not None:
            picture.imshow(view(image), cmap="gray", vmin=0, vmax=255)
        draw_overlay(picture, view, step, registration, series.bounds("theta_deg"))
        picture.set_title(
            f"{series.time_s[number]:.1f} s  {step.conclusion.state.replace('_', ' ')}",
            fontsize=9,
            pad=10,
            color=paint.ink,
            bbox={"boxstyle": "round", "facecolor": paint.color, "edgecolor": "none"},
        )
        draw_graph(graph, step.graph)


def _draw_timeline(figure: "Figure", series: _Series) -> None:
    rows = figure.subplots(4, 1, sharex=True, height_ratios=(0.8, 1.2, 1.4, 0.8))
    band, theta, distance, haptics = rows
    _draw_states(band, series)
    for axes in (theta, distance):
        for start, end, state in _intervals(series):
            axes.axvspan(
                *_span(series, start, end), color=series.paints[state].color, alpha=0.18, linewidth=0
            )
    is_scan = bool(series.bounds(DEPTHS[0]))
    angle, names = ("incidence_deg", DEPTHS) if is_scan else ("theta_deg", DISTANCES)
    for bound_deg in series.bounds("theta_deg")[:1]:
        theta.axhspan(0, bound_deg, color="#3a9d5d", alpha=0.15, linewidth=0)
    theta.plot(series.time_s, _column(series, angle), color="#333", linewidth=1.2)
    theta.set(ylabel=f"{angle.removesuffix('_deg')} [deg]", ylim=(0, None))
    for name, color in zip(names, DISTANCE_COLORS, strict=True):
        label = name.rpartition("_")[0].replace("_", " ")
        distance.plot(series.time_s, _column(series, name), color=color, linewidth=1.2, label=label)
    for bound in series.bounds(names[0]):
        distance.axhline(bound, color="#888", linewidth=0.8, linestyle="--")
    distance.set(ylabel=f"distance [{names[0][-2:]}]", ylim=(None if is_scan else -0.5, None))
    distance.legend(loc="upper center" if is_scan else "upper right", fontsize=8, frameon=False)
    fine_s, amplitude = _amplitudes(series)
    haptics.fill_between(fine_s, amplitude, step="post", color=HAPTICS_COLOR, linewidth=0)
    haptics.set(
        ylabel="haptic output", ylim=(0, 1.05), xlabel="time [s]", xlim=(0, max(series.time_s[-1], 1e-3))
    )
    for axes in rows:
        axes.spines[["top", "right"]].set_visible(False)
    figure.align_ylabels(rows)


def _draw_states(axes: "Axes", series: _Series) -> None:
    """Draw states as coloured bands, with their names where they fit."""
    total_s = max(series.time_s[-1], 1e-3)
    for start, end, state in _intervals(series):
        left, right = _span(series, start, end)
        paint = series.paints[state]
        axes.axvspan(left, right, color=paint.color, linewidth=0)
        if right - left > 0.06 * total_s:
            name = state.replace("_", "\n")
            axes.text((left + right) / 2, 0.5, name, ha="center", va="center", fontsize=7.5, color=paint.ink)
    axes.set(yticks=[], ylabel="state", ylim=(0, 1))


def _span(series: _Series, start: int, end: int) -> tuple[float, float]:
    return series.time_s[start], series.time_s[min(end, len(series.time_s) - 1)]


def _column(series: _Series, measure: str) -> list[float]:
    return [step.graph.measures.get(measure, float("nan")) for step in series.steps]


def _amplitudes(series: _Series) -> tuple[list[float], list[float]]:
    """Return the commanded amplitude, sampled finely enough to show every pulse."""
    start_ns = series.steps[0].stamp_ns
    times, amplitudes = [], []
    for step, later in zip(series.steps, [*series.steps[1:], series.steps[-1]], strict=True):
        for stamp_ns in range(step.stamp_ns, max(later.stamp_ns, step.stamp_ns + 1), 5_000_000):
            times.append((stamp_ns - start_ns) / 1e9)
            amplitudes.append(amplitude_at(step.command, stamp_ns))
    return times, amplitudes
