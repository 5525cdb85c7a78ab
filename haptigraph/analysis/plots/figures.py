"""Figures of recorded runs: images, scene graphs, states, measures and haptic output over time."""

from collections import Counter
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from haptigraph.analysis.plots.drawing import draw_overlay, grey_norm
from haptigraph.analysis.plots.paper import scale_bar
from haptigraph.analysis.plots.scene_graph import draw_graph
from haptigraph.analysis.plots.series import Series, read_series
from haptigraph.analysis.plots.timeline import draw_timeline
from haptigraph.errors import BadInput
from haptigraph.figures import Figure, FigureBase
from haptigraph.messages import UNKNOWN, Image
from haptigraph.perception.eye_view import view_of
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.registered import BaseRegistration
from haptigraph.sources.naming import is_simulated

__all__ = ["run_figure"]

MAX_MOMENTS, MAX_WIDE = 5, 3
"""Moments shown; of graphs with more than two groups of nodes, which are wide."""
WIDTH_IN, DPI = 12.0, 130
TIMELINE_IN, HEADINGS_IN, NODE_IN, WIDEST_IN = 5.0, 1.0, 0.36, 3.2
"""Height of the timeline, of title and legend, of a node; greatest width of a picture."""
BARS_MM = (5.0, 1.0, 0.5, 0.2)
"""Lengths of a scale bar; the first that is at most a third of the picture."""
Limits: TypeAlias = tuple[tuple[float, float], tuple[float, float]]


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
    series = read_series(reader)
    report("drawing", 1, 3)
    moments = _moments(series)
    records = reader.records(images=set(moments))
    images = {number: capture.image for number, (capture, _) in enumerate(records) if number in moments}
    report("drawing", 2, 3)
    registration = parse_registration(reader.info.registration, f"registration in {path}")
    view = view_of(registration)
    views = {
        number: view(image, series.steps[number].observation.found)
        for number, image in images.items()
        if image is not None
    }
    limits = _shown(list(views.values()), view.size_px)
    heights_in = _heights_in(series, moments, limits) if moments else (0.1, 0.1, TIMELINE_IN)
    figure = Figure(figsize=(WIDTH_IN, sum(heights_in)), layout="constrained")
    pictures, graphs, bottom = np.ravel(np.asarray(figure.subfigures(3, 1, height_ratios=heights_in)))
    if moments:
        _draw_pictures(
            pictures, series, {number: views.get(number) for number in moments}, registration, limits
        )
        for axes, number in zip(graphs.subplots(1, len(moments), squeeze=False)[0], moments, strict=True):
            draw_graph(axes, series.steps[number].graph, series.procedure.schema.relations)
    draw_timeline(bottom, series)
    simulated = " (simulated)" if is_simulated(reader.info.source) else ""
    who = f" · participant {reader.info.participant}" if reader.info.participant else ""
    figure.suptitle(f"haptigraph {reader.info.version} · {reader.info.source}{simulated}{who}", fontsize=10)
    try:
        figure.savefig(output, dpi=DPI)
    except OSError as error:  # that of a full disk does not name the file
        raise BadInput(f"cannot be written ({error.strerror})", output) from None
    report("drawing", 3, 3)


def _moments(series: Series) -> list[int]:
    """Choose the steps to show: the middle of the longest interval of each state, in order of time."""
    longest: dict[str, tuple[int, int]] = {}
    for start, end, state in series.intervals():
        if state != UNKNOWN and end - start > longest.get(state, (0, 0))[1] - longest.get(state, (0, 0))[0]:
            longest[state] = start, end
    rarest_first = sorted(longest.values(), key=lambda interval: interval[1] - interval[0])
    groups = {entity.group for entity in series.procedure.schema.entities}
    return sorted(
        (start + end) // 2 for start, end in rarest_first[: MAX_MOMENTS if len(groups) < 3 else MAX_WIDE]
    )


def _heights_in(series: Series, moments: list[int], limits: Limits) -> tuple[float, float, float]:
    """Return the heights of pictures, graphs and timeline."""
    (left, right), (below, above) = limits
    width_in = min(WIDTH_IN / len(moments), WIDEST_IN)
    columns = [Counter(node.group for node in series.steps[number].graph.nodes) for number in moments]
    nodes = max((count for column in columns for count in column.values()), default=1)
    picture_in = width_in * abs(above - below) / abs(right - left) + HEADINGS_IN
    return picture_in, NODE_IN * max(nodes, 3) + 0.3, TIMELINE_IN


def _draw_pictures(
    figure: FigureBase,
    series: Series,
    views: dict[int, Image | None],
    registration: BaseRegistration,
    limits: Limits,
) -> None:
    """Draw the views of some moments, all with one range of grey, one scale bar and one legend."""
    view = view_of(registration)
    entries: dict[str, Any] = {}
    norm = grey_norm([each for each in views.values() if each is not None])
    all_axes = figure.subplots(1, len(views), squeeze=False)[0]
    for axes, (number, picture) in zip(all_axes, views.items(), strict=True):
        step = series.steps[number]
        if picture is not None:
            axes.imshow(picture, cmap="gray", norm=norm)
        draw_overlay(axes, view, step, registration, series.bounds("theta_deg"))
        axes.set(xlim=limits[0], ylim=limits[1], aspect="equal")
        entries |= {name: line for line, name in zip(*axes.get_legend_handles_labels(), strict=True)}
        axes.set_title(
            f"{series.time_s[number]:.1f} s  {step.conclusion.state.replace('_', ' ')}",
            fontsize=8.5,
            pad=8,
            color=series.ink(step.conclusion.state),
            bbox={"boxstyle": "round", "facecolor": series.color(step.conclusion.state), "edgecolor": "none"},
        )
    px_per_mm = view.size_px / (2 * view.half_mm)
    third_mm = abs(limits[0][1] - limits[0][0]) / px_per_mm / 3
    bar_mm = next((bar for bar in BARS_MM if bar <= third_mm), BARS_MM[-1])
    scale_bar(all_axes[0], bar_mm * px_per_mm, f"{bar_mm:g} mm", size_pt=8)
    style: dict[str, Any] = {
        "labelcolor": "white",
        "facecolor": "#3a3a3a",
        "framealpha": 1,
        "edgecolor": "none",
    }
    figure.legend(
        list(entries.values()), list(entries), loc="outside lower center", ncols=8, fontsize=8, **style
    )  # fmt: skip


def _shown(views: list[Image], size_px: int) -> Limits:
    """Return the limits along x and y of what is not black: a B-scan fills only part of its view."""
    any_of = np.any([view > 0 for view in views], axis=0) if views else np.ones((size_px, size_px), np.bool_)
    rows, columns = (np.flatnonzero(any_of.any(axis=axis)) for axis in (1, 0))
    if not rows.size:
        return (0, size_px - 1), (size_px - 1, 0)
    return (columns[0] - 4, columns[-1] + 4), (rows[-1] + 4, rows[0] - 4)
