"""Draw a run over time: states, angle, distances with their thresholds, haptic output."""

from typing import TYPE_CHECKING, Any

import numpy as np

from haptigraph.analysis.plots.paper import COLORS, DASHES, letter
from haptigraph.analysis.plots.series import Series
from haptigraph.figures import FigureBase, Patch, SubFigure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_timeline"]

CURVES = tuple(zip(("black", "red", "blue", "green"), DASHES, strict=True))
"""Colour and line style of each curve of a panel."""
WALL = "wall_mm"  # decides inside and outside, which the states show
HAPTICS = "haptic output"
ROOM = 1.1  # above the highest curve
ABOVE: dict[str, Any] = {
    "loc": "lower right",
    "bbox_to_anchor": (1, 1),
    "borderaxespad": 0.2,
    "fontsize": "small",
}
"""Place of a legend, beside the panel's title."""
NAMED_SHARE = 0.1  # of the whole time: shorter bands have no room for a name


def draw_timeline(figure: "FigureBase | SubFigure", series: Series) -> None:
    """Draw a run into a figure, in panels with letters: two for what the run measured.

    Args:
        figure: An empty figure with a constrained layout.
        series: The run.
    """
    angles, distances = _measured(series, ("_deg",)), _measured(series, ("_mm", "_um"))
    shown = [
        ("state", 0.8),
        *([("angle", 1.2)] if angles else []),
        *([("distances", 1.4)] if distances else []),
    ]
    shown.append(("haptic output", 0.8))
    rows = figure.subplots(len(shown), 1, sharex=True, height_ratios=[height for _, height in shown])
    panel = {title: axes for (title, _), axes in zip(shown, rows, strict=True)}
    _draw_states(panel["state"], series)
    if angles:
        _draw_angle(panel["angle"], series, angles[0])
    if distances:
        _draw_distances(panel["distances"], series, distances)
    _draw_haptics(panel[HAPTICS], series)
    for name, (title, axes) in zip("abcd", panel.items(), strict=False):
        letter(axes, name, title)
        axes.spines[["top", "right"]].set_visible(False)
    figure.align_ylabels(rows)


def _measured(series: Series, units: tuple[str, ...]) -> list[str]:
    """Return the measures in some units that the run has, as many as a panel can show."""
    names = [name for name in series.procedure.schema.measure_names if name.endswith(units) and name != WALL]
    return [name for name in names if not np.isnan(series.column(name)).all()][: len(CURVES)]


def _shade(axes: "Axes", series: Series) -> None:
    """Show the states faintly behind curves."""
    for start, end, state in series.intervals():
        axes.axvspan(*series.span_s(start, end), color=series.color(state), alpha=0.18, linewidth=0)


def _draw_states(axes: "Axes", series: Series) -> None:
    """Draw states as coloured bands, with their names where they fit, and all of them in a legend."""
    total_s = max(series.time_s[-1], 1e-3)
    for start, end, state in series.intervals():
        left, right = series.span_s(start, end)
        axes.axvspan(left, right, color=series.color(state), linewidth=0)
        if right - left > NAMED_SHARE * total_s:
            axes.text(
                *((left + right) / 2, 0.5, state.replace("_", "\n")),
                ha="center", va="center", fontsize="small", color=series.ink(state),
            )  # fmt: skip
    occurring = {state for _, _, state in series.intervals()}
    patches = [
        Patch(
            facecolor=series.color(state.name),
            edgecolor="#555",
            linewidth=0.4,
            label=state.name.replace("_", " "),
        )
        for state in series.procedure.states
        if state.name in occurring
    ]
    axes.legend(handles=patches, **ABOVE, ncols=min(len(patches), 4), frameon=False)
    axes.set(yticks=[], ylim=(0, 1))


def _draw_angle(axes: "Axes", series: Series, measure: str) -> None:
    _shade(axes, series)
    name, values = measure.removesuffix("_deg"), series.column(measure)
    axes.plot(series.time_s, values, color=COLORS["black"], label=name)
    for bound_deg in [bound for bound in series.bounds(measure) if bound > 0][:1]:
        axes.axhspan(
            0, bound_deg, color=COLORS["green"], alpha=0.25, linewidth=0, label=f"up to {bound_deg:g}°"
        )
    axes.set(ylabel=f"{name} [°]", ylim=(0, ROOM * max(float(np.nanmax(values)), 1.0)))
    axes.legend(**ABOVE, ncols=2, frameon=False)


def _draw_distances(axes: "Axes", series: Series, names: list[str]) -> None:
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


def _draw_haptics(axes: "Axes", series: Series) -> None:
    fine_s, amplitude = series.amplitudes()
    axes.fill_between(fine_s, amplitude, step="post", color=COLORS["purple"], linewidth=0, label="amplitude")
    failed_s = series.device_faults_s()
    if failed_s:  # what was commanded was perhaps not played
        label = "device fault"
        axes.plot(failed_s, [1.0] * len(failed_s), "x", color=COLORS["red"], markersize=5, label=label)
        axes.legend(**ABOVE, ncols=2, frameon=False)
    axes.set(ylabel="amplitude", ylim=(0, 1.1), xlabel="time [s]", xlim=(0, max(series.time_s[-1], 1e-3)))
