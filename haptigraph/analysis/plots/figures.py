"""Figures of recorded runs: images, scene graphs, states, measures and haptic output over time."""

from pathlib import Path

import numpy as np

from haptigraph.analysis.plots.drawing import draw_graph, draw_overlay
from haptigraph.analysis.plots.series import Series, read_series
from haptigraph.analysis.plots.timeline import draw_timeline
from haptigraph.errors import BadInput
from haptigraph.figures import Figure
from haptigraph.messages import UNKNOWN, Image
from haptigraph.perception.eye_view import view_of
from haptigraph.recording.reader import RunReader
from haptigraph.recording.writer import Progress
from haptigraph.registration.loading import parse_registration
from haptigraph.registration.registered import BaseRegistration

__all__ = ["run_figure"]

MAX_MOMENTS = 5


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
    figure = Figure(figsize=(14, 11), layout="constrained")
    top, bottom = np.ravel(np.asarray(figure.subfigures(2, 1, height_ratios=(0.95, 1))))
    if moments:
        _draw_moments(top, series, moments, images, registration)
    draw_timeline(bottom, series)
    simulated = " (simulated)" if reader.info.source.startswith("phantom:") else ""
    who = f" · participant {reader.info.participant}" if reader.info.participant else ""
    figure.suptitle(f"haptigraph {reader.info.version} · {reader.info.source}{simulated}{who}")
    try:
        figure.savefig(output, dpi=110)
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
    return sorted((start + end) // 2 for start, end in rarest_first[:MAX_MOMENTS])


def _draw_moments(
    figure: "Figure",
    series: Series,
    moments: list[int],
    images: dict[int, Image | None],
    registration: BaseRegistration,
) -> None:
    axes = figure.subplots(2, len(moments), squeeze=False, height_ratios=(1.25, 1))
    view = view_of(registration)
    for column, number in enumerate(moments):
        step, picture, graph = series.steps[number], axes[0, column], axes[1, column]
        image = images.get(number)
        if image is not None:
            picture.imshow(view(image, step.observation.found), cmap="gray", vmin=0, vmax=255)
        draw_overlay(picture, view, step, registration, series.bounds("theta_deg"))
        picture.set_title(
            f"{series.time_s[number]:.1f} s  {step.conclusion.state.replace('_', ' ')}",
            fontsize=9,
            pad=10,
            color=series.ink(step.conclusion.state),
            bbox={"boxstyle": "round", "facecolor": series.color(step.conclusion.state), "edgecolor": "none"},
        )
        draw_graph(graph, step.graph)
