"""Draw a run over time: states, angle, distances with their thresholds, haptic output."""

from typing import TYPE_CHECKING

from matplotlib.figure import FigureBase, SubFigure
from matplotlib.patches import Patch

from haptigraph.analysis.plots.colors import ink_on, state_color
from haptigraph.analysis.plots.paper import COLORS, DASHES, letter
from haptigraph.analysis.plots.series import Series

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["draw_timeline"]

DISTANCES = ("distance_to_retina_mm", "distance_to_target_mm", "radial_mm")
DEPTHS = ("above_retina_um", "above_target_um", "above_rpe_um")  # of B-scans
DISTANCE_COLORS = (COLORS["black"], COLORS["blue"], COLORS["red"])
NAMED_SHARE = 0.1  # of the whole time: shorter bands have no room for a name


def draw_timeline(figure: "FigureBase | SubFigure", series: Series) -> None:
    """Draw a run into a figure, in four panels with letters.

    Args:
        figure: An empty figure with a constrained layout.
        series: The run.
    """
    rows = figure.subplots(4, 1, sharex=True, height_ratios=(0.8, 1.2, 1.4, 0.8))
    band, theta, distance, haptics = rows
    _draw_states(band, series)
    for axes in (theta, distance):
        for start, end, state in series.intervals():
            axes.axvspan(*series.span_s(start, end), color=state_color(state), alpha=0.18, linewidth=0)
    is_scan = bool(series.bounds(DEPTHS[0]))
    angle, names = ("incidence_deg", DEPTHS) if is_scan else ("theta_deg", DISTANCES)
    _draw_angle(theta, series, angle)
    _draw_distances(distance, series, names)
    fine_s, amplitude = series.amplitudes()
    haptics.fill_between(
        fine_s, amplitude, step="post", color=COLORS["purple"], linewidth=0, label="amplitude"
    )
    haptics.set(ylabel="amplitude", ylim=(0, 1.05), xlabel="time [s]", xlim=(0, max(series.time_s[-1], 1e-3)))
    for axes, name, title in zip(rows, "abcd", ("state", "angle", "distances", "haptic output"), strict=True):
        letter(axes, name, title)
        axes.spines[["top", "right"]].set_visible(False)
    figure.align_ylabels(rows)


def _draw_states(axes: "Axes", series: Series) -> None:
    """Draw states as coloured bands, with their names where they fit, and all of them in a legend."""
    total_s = max(series.time_s[-1], 1e-3)
    for start, end, state in series.intervals():
        left, right = series.span_s(start, end)
        axes.axvspan(left, right, color=state_color(state), linewidth=0)
        if right - left > NAMED_SHARE * total_s:
            axes.text(
                *((left + right) / 2, 0.5, state.replace("_", "\n")),
                ha="center", va="center", fontsize="small", color=ink_on(state),
            )  # fmt: skip
    occurring = {state for _, _, state in series.intervals()}
    patches = [
        Patch(
            facecolor=state_color(state.name),
            edgecolor="#555",
            linewidth=0.4,
            label=state.name.replace("_", " "),
        )
        for state in series.procedure.states
        if state.name in occurring
    ]
    axes.legend(
        handles=patches,
        loc="lower right",
        bbox_to_anchor=(1, 1),
        ncols=min(len(patches), 4),
        fontsize="small",
    )
    axes.set(yticks=[], ylim=(0, 1))


def _draw_angle(axes: "Axes", series: Series, measure: str) -> None:
    name = measure.removesuffix("_deg")
    axes.plot(series.time_s, series.column(measure), color=COLORS["black"], label=name)
    for bound_deg in series.bounds(measure)[:1]:
        axes.axhspan(
            0, bound_deg, color=COLORS["green"], alpha=0.25, linewidth=0, label=f"up to {bound_deg:g}°"
        )
    axes.set(ylabel=f"{name} [°]", ylim=(0, None))
    axes.legend(loc="upper right", ncols=2)


def _draw_distances(axes: "Axes", series: Series, names: tuple[str, ...]) -> None:
    unit = names[0].rpartition("_")[2].replace("um", "µm")
    for name, color, dashes in zip(names, DISTANCE_COLORS, DASHES, strict=True):
        label = name.rpartition("_")[0].replace("_", " ")
        axes.plot(series.time_s, series.column(name), color=color, linestyle=dashes, label=label)
    bounds = series.bounds(names[0])
    for number, bound in enumerate(bounds):
        label = f"thresholds: {', '.join(f'{value:g}' for value in bounds)} {unit}" if not number else "_"
        axes.axhline(bound, color=COLORS["grey"], linewidth=0.7, linestyle="--", label=label)
    axes.set(ylabel=f"distance [{unit}]", ylim=(None if unit == "µm" else -0.5, None))
    axes.legend(loc="upper right", ncols=2)
