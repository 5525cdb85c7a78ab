"""Traces of one participant's runs as small multiples: theta and distance to the retina over time."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from haptigraph.analysis.study.figures.style import (
    INK,
    SMALL_PT,
    TWO_COLUMNS_MM,
    declutter,
    legend_below,
    legend_rows,
    new_figure,
    paint_of,
    wrapped,
)
from haptigraph.analysis.study.quantities import words
from haptigraph.analysis.study.traces import GRID, Floats, Trace, Traces
from haptigraph.figures import Figure, Patch

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["person_figure"]

MAX_COLUMNS = 4
TOP_MM, HEAD_MM, PANEL_MM, GAP_MM, LEFT_MM = 5.0, 8.0, 20.0, 3.0, 13.0
AXIS_MM, BETWEEN_MM = 9.0, 7.0
LEGEND_MM, LEGEND_ROW_MM = 3.0, 3.5
TRACED = {"theta_deg": "theta (°)", "distance_mm": "distance (mm)"}


def person_figure(traces: Traces, shown: Sequence[Trace], names: Mapping[int, str], note: str) -> Figure:
    """Draw a column of two panels per run, on scales that are the same for every participant.

    Args:
        traces: Those of the study, for the scales and the states.
        shown: Those of the participant, at least one.
        names: What a run is called, by its row in the analysed runs.
        note: A mark in the corner, such as that the data are simulated.
    """
    columns = min(MAX_COLUMNS, max(2, len(shown)))
    band_mm = HEAD_MM + 2 * PANEL_MM + GAP_MM + AXIS_MM
    states = dict.fromkeys(state for run in shown for _, state in run.states)
    patches = [Patch(color=paint_of(state).color, alpha=0.6, label=words(state)) for state in states]
    legend_mm = LEGEND_MM + LEGEND_ROW_MM * legend_rows(patches, TWO_COLUMNS_MM)
    height_mm = TOP_MM + -(-len(shown) // columns) * band_mm + legend_mm
    figure = new_figure(TWO_COLUMNS_MM, height_mm, note)
    figure.set_layout_engine(None)  # a constrained layout of many panels takes seconds per participant
    step_mm = (TWO_COLUMNS_MM - LEFT_MM) / columns
    for number, run in enumerate(shown):
        band, column = divmod(number, columns)
        left_mm = LEFT_MM + column * step_mm
        bottom_mm = height_mm - TOP_MM - band * band_mm - HEAD_MM
        for name, label in TRACED.items():
            bottom_mm -= PANEL_MM
            box_mm = left_mm, bottom_mm, step_mm - BETWEEN_MM, PANEL_MM
            sides_mm = TWO_COLUMNS_MM, height_mm, TWO_COLUMNS_MM, height_mm
            axes = figure.add_axes(tuple(np.divide(box_mm, sides_mm)))
            _draw(axes, traces, run, name)
            axes.set_ylabel("" if column else label)
            bottom_mm -= GAP_MM
        upper, lower = figure.axes[-2:]
        upper.tick_params(labelbottom=False)
        upper.set_title(wrapped(names[run.run], step_mm - BETWEEN_MM), fontsize=SMALL_PT, loc="left", pad=2)
        lower.set_xlabel("time (s)")
    legend_below(figure, patches, "lower center")
    return figure


def _draw(axes: "Axes", traces: Traces, run: Trace, name: str) -> None:
    for (since_s, state), (until_s, _) in pairwise([*run.states, (run.duration_s, "")]):
        axes.axvspan(since_s, until_s, color=paint_of(state).color, alpha=0.6, linewidth=0)
    axes.plot(run.duration_s * GRID, getattr(run, name), color=INK, linewidth=0.8)
    axes.set_xlim(0, max(each.duration_s for each in traces.runs))
    axes.set_ylim(_limits([getattr(each, name) for each in traces.runs]))
    declutter(axes)


def _limits(columns: Sequence[Floats]) -> tuple[float, float]:
    values = np.concatenate(columns)
    return min(0.0, float(np.nanmin(values))), 1.03 * float(np.nanmax(values))
