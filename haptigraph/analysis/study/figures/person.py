"""Traces of one participant's runs as small multiples: theta and distance to the retina over time."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from haptigraph.analysis.study.figures.style import (
    INK,
    SMALL_PT,
    TWO_COLUMNS_MM,
    declutter,
    new_figure,
    paint_of,
    wrapped,
)
from haptigraph.analysis.study.traces import GRID, Floats, Trace, Traces

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["person_figure"]

COLUMNS = 4
ROW_MM, HEAD_MM, LEFT_MM = 27.0, 9.0, 13.0
TRACED = {"theta_deg": "theta (°)", "distance_mm": "distance (mm)"}


def person_figure(traces: Traces, shown: Sequence[Trace], names: Mapping[int, str], note: str) -> Figure:
    """Draw a column of two panels per run, on scales that are the same for every participant.

    Args:
        traces: Those of the study, for the scales.
        shown: Those of the participant, at least one.
        names: What a run is called, by its row in the analysed runs.
        note: A mark in the corner, such as that the data are simulated.
    """
    bands = -(-len(shown) // COLUMNS)
    height_mm = bands * (HEAD_MM + 2 * ROW_MM) + 12
    figure = new_figure(TWO_COLUMNS_MM, height_mm, note)
    figure.set_layout_engine("none")  # a constrained layout of many panels takes seconds per participant
    longest_s = max(run.duration_s for run in traces.runs)
    limits = [_limits([getattr(run, name) for run in traces.runs]) for name in TRACED]
    for number, run in enumerate(shown):
        band, column = divmod(number, COLUMNS)
        for row, (name, label) in enumerate(TRACED.items()):
            bottom_mm = height_mm - 5 - band * (HEAD_MM + 2 * ROW_MM) - HEAD_MM - (row + 1) * ROW_MM + 7
            axes = figure.add_axes(_place(column, bottom_mm, height_mm))
            _draw_states(axes, run)
            axes.plot(run.duration_s * GRID, getattr(run, name), color=INK, linewidth=0.8)
            axes.set(xlim=(0, longest_s), ylim=limits[row])
            declutter(axes)
            if not column:
                axes.set_ylabel(label)
            if row:
                axes.set_xlabel("time (s)")
            else:
                axes.tick_params(labelbottom=False)
                axes.set_title(wrapped(names[run.run], 36), fontsize=SMALL_PT, loc="left", pad=2)
    return figure


def _place(column: int, bottom_mm: float, height_mm: float) -> tuple[float, float, float, float]:
    """Return left, bottom, width and height of a panel, as shares of the figure."""
    step_mm = (TWO_COLUMNS_MM - LEFT_MM) / COLUMNS
    left_mm = LEFT_MM + column * step_mm
    return (
        left_mm / TWO_COLUMNS_MM,
        bottom_mm / height_mm,
        (step_mm - 7) / TWO_COLUMNS_MM,
        (ROW_MM - 7) / height_mm,
    )


def _limits(columns: Sequence[Floats]) -> tuple[float, float]:
    values = np.concatenate(columns)
    return min(0.0, float(np.nanmin(values))), 1.03 * float(np.nanmax(values))


def _draw_states(axes: "Axes", run: Trace) -> None:
    ends = [*run.states, (run.duration_s, "")]
    for (since_s, state), (until_s, _) in pairwise(ends):
        axes.axvspan(since_s, until_s, color=paint_of(state).color, alpha=0.6, linewidth=0)
