"""Draw a run over time: states, angle, distances with their thresholds, haptic output."""

from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from haptigraph.analysis.plots.paper import COLORS, DASHES, letter
from haptigraph.analysis.plots.series import Series
from haptigraph.figures import Axes, FigureBase, Patch, SubFigure

__all__ = ["draw_timeline"]

Spans: TypeAlias = list[tuple[float, float]]
CURVES = tuple(zip(("black", "red", "blue", "green"), DASHES, strict=True))
"""Colour and line style of each curve of a panel."""
WALL = "wall_mm"  # decides inside and outside, which the states show
ROOM = 1.1  # above the highest curve
ABOVE: dict[str, Any] = {
    "loc": "lower right",
    "bbox_to_anchor": (1, 1),
    "borderaxespad": 0.2,
    "fontsize": "small",
}
"""Place of a legend, beside the panel's title."""
LETTER_SHARE = 0.0075  # of the whole time: room for a letter of a band's name; without room there is no name
DIFFERS: dict[str, Any] = {"color": COLORS["black"], "linewidth": 0}
"""Style of the thin band that marks where two runs differ."""
BAND = (-0.2, 0.14)  # its lower edge and height, below what is drawn from 0 to 1


def draw_timeline(
    figure: FigureBase | SubFigure, series: Series, other: Series | None = None, name: str = "replayed"
) -> None:
    """Draw a run into a figure, in panels with letters: two for what the run measured.

    Args:
        figure: An empty figure with a constrained layout.
        series: The run.
        other: The same images under another procedure: its states and its haptic output are drawn below, with
            a mark where they differ.
        name: Of the other procedure.
    """
    panels: list[tuple[str, float, Callable[[Axes], None]]] = []
    both = [("", series)] if other is None else [(", recorded", series), (f", {name}", other)]
    differing = [([], [])] if other is None else [([], []), _differing_s(series, other)]
    for (title, each), (spans_s, _) in zip(both, differing, strict=True):
        panels.append((f"state{title}", 0.8, partial(_draw_states, series=each, differing_s=spans_s)))
    if angles := _measured(series, ("_deg",)):
        panels.append(("angle", 1.2, partial(_draw_angle, series=series, measure=angles[0], other=other)))
    if distances := _measured(series, ("_mm", "_um")):
        panels.append(("distances", 1.4, partial(_draw_distances, series=series, names=distances)))
    for (title, each), (_, spans_s) in zip(both, differing, strict=True):
        output = f"haptic output{title}"
        panels.append((output, 0.8, partial(_draw_haptics, series=each, differing_s=spans_s)))
    heights = [height for _, height, _ in panels]
    rows = figure.subplots(len(panels), 1, sharex=True, height_ratios=heights)
    for number, ((title, _, draw), axes) in enumerate(zip(panels, rows, strict=True)):
        draw(axes)
        letter(axes, "abcdef"[number], title)
        axes.spines[["top", "right"]].set_visible(False)
    _name_states(rows[0], both, differing[-1][0])
    rows[-1].set(xlabel="time [s]", xlim=(0, max(series.time_s[-1], 1e-3)))
    figure.align_ylabels(rows)


def _differing_s(series: Series, other: Series) -> tuple[Spans, Spans]:
    """Return when the states of two runs of the same images differ [s], and when their haptic output."""
    both = list(zip(series.steps, other.steps, strict=True))
    differs = (
        [one.conclusion.state != another.conclusion.state for one, another in both],
        [one.command.pattern != another.command.pattern for one, another in both],
    )
    states, haptics = (
        [series.span_s(row, row + 1) for row, is_other in enumerate(each) if is_other] for each in differs
    )
    return states, haptics


def _mark(axes: Axes, differing_s: Spans, height: float = 1.0) -> None:
    """Mark where a run differs from the recorded one, in a thin band below; nothing if it does nowhere."""
    if not differing_s:
        return
    spans = [(start_s, end_s - start_s) for start_s, end_s in differing_s]
    axes.broken_barh(spans, BAND, label=_lasts(differing_s), **DIFFERS)
    axes.set(ylim=(BAND[0] - 0.05, height))


def _lasts(differing_s: Spans) -> str:
    return f"differs: {sum(end_s - start_s for start_s, end_s in differing_s):.2f} s"


def _measured(series: Series, units: tuple[str, ...]) -> list[str]:
    """Return the measures in some units that the run has, as many as a panel can show."""
    names = [name for name in series.procedure.schema.measure_names if name.endswith(units) and name != WALL]
    return [name for name in names if not np.isnan(series.column(name)).all()][: len(CURVES)]


def _shade(axes: Axes, series: Series) -> None:
    """Show the states faintly behind curves."""
    for start, end, state in series.intervals():
        axes.axvspan(*series.span_s(start, end), color=series.color(state), alpha=0.18, linewidth=0)


def _draw_states(axes: Axes, series: Series, differing_s: Spans) -> None:
    """Draw states as coloured bands, with their names where they fit."""
    total_s = max(series.time_s[-1], 1e-3)
    for start, end, state in series.intervals():
        left, right = series.span_s(start, end)
        axes.broken_barh([(left, right - left)], (0, 1), color=series.color(state), linewidth=0)
        if right - left > LETTER_SHARE * total_s * max(map(len, state.split("_"))):
            axes.text(
                *((left + right) / 2, 0.5, state.replace("_", "\n")),
                ha="center", va="center", fontsize="small", color=series.ink(state),
            )  # fmt: skip
    axes.set(yticks=[], ylim=(0, 1))
    _mark(axes, differing_s)


def _name_states(axes: Axes, both: list[tuple[str, Series]], differing_s: Spans) -> None:
    """Name the colours of all states that occur, of both procedures, and of the mark where they differ."""
    colors = {
        state.name: each.color(state.name)
        for _, each in both
        for state in each.procedure.states
        if state.name in {name for _, _, name in each.intervals()}
    }
    patches = [
        Patch(facecolor=color, edgecolor="#555", linewidth=0.4, label=name.replace("_", " "))
        for name, color in colors.items()
    ]
    if differing_s:
        patches.append(Patch(label=_lasts(differing_s), **DIFFERS))
    axes.legend(handles=patches, **ABOVE, ncols=min(len(patches), 4), frameon=False)


def _draw_angle(axes: Axes, series: Series, measure: str, other: Series | None) -> None:
    _shade(axes, series)
    name, values = measure.removesuffix("_deg"), series.column(measure)
    axes.plot(series.time_s, values, color=COLORS["black"], label=name)
    allowed_deg = _least(series, measure)
    if allowed_deg is not None:
        label = f"up to {allowed_deg:g}°"
        axes.axhspan(0, allowed_deg, color=COLORS["green"], alpha=0.25, linewidth=0, label=label)
    changed_deg = _least(other, measure) if other else None
    if changed_deg not in (None, allowed_deg):
        label = f"up to {changed_deg:g}° as replayed"
        axes.axhline(changed_deg, color=COLORS["green"], linestyle="--", linewidth=0.9, label=label)
    axes.set(ylabel=f"{name} [°]", ylim=(0, ROOM * max(float(np.nanmax(values)), 1.0)))
    axes.legend(**ABOVE, ncols=3, frameon=False)


def _least(series: Series, measure: str) -> float | None:
    return next((bound for bound in series.bounds(measure) if bound > 0), None)


def _draw_distances(axes: Axes, series: Series, names: list[str]) -> None:
    _shade(axes, series)
    unit = names[0].rpartition("_")[2].replace("um", "µm")
    for name, (color, dashes) in zip(names, CURVES, strict=False):
        label = name.rpartition("_")[0].replace("_", " ")
        axes.plot(series.time_s, series.column(name), color=COLORS[color], linestyle=dashes, label=label)
    bounds, first = series.bounds(names[0]), names[0].rpartition("_")[0].replace("_", " ")
    for number, bound in enumerate(bounds):
        values = ", ".join(f"{value:g}" for value in bounds)
        label = f"thresholds of {first}: {values} {unit}" if not number else "_"
        axes.axhline(bound, color=COLORS["grey"], linewidth=0.7, linestyle="--", label=label)
    low, high = axes.get_ylim()
    axes.set(ylabel=f"distance [{unit}]", ylim=(low, low + ROOM * (high - low)))
    axes.legend(**ABOVE, ncols=len(names) + 1, frameon=False)


def _draw_haptics(axes: Axes, series: Series, differing_s: Spans) -> None:
    fine_s, amplitude = series.amplitudes()
    purple, red, black = COLORS["purple"], COLORS["red"], COLORS["black"]
    axes.fill_between(fine_s, amplitude, step="post", color=purple, linewidth=0, label="commanded")
    if series.confirmed_s is not None:  # the guard, or the device, may have played less
        spans = [(start_s, end_s - start_s) for start_s, end_s in series.confirmed_s]
        label = f"confirmed: {sum(width_s for _, width_s in spans):.2f} s"
        axes.broken_barh(spans, (1.05, 0.1), color=black, linewidth=0, label=label)
    if failed_s := series.device_faults_s():
        axes.plot(failed_s, [1.0] * len(failed_s), "x", color=red, markersize=5, label="device fault")
    axes.set(ylabel="amplitude", ylim=(0, 1.2))
    _mark(axes, differing_s, 1.2)
    axes.legend(**ABOVE, ncols=4, frameon=False)
