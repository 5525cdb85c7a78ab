"""Figures of motion: alignment over normalised time, and depth against theta."""

from typing import TYPE_CHECKING, Any

import numpy as np

from haptigraph.analysis.study.figures.style import (
    INK,
    ONE_COLUMN_MM,
    QUIET_INK,
    SMALL_PT,
    TWO_COLUMNS_MM,
    ConditionStyle,
    condition_styles,
    declutter,
    legend_below,
    new_figure,
    paint_of,
    wrapped,
)
from haptigraph.analysis.study.traces import GRID, Traces, Zones
from haptigraph.figures import Figure, Line2D

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["alignment_figure", "cone_figure"]

CONE_COLOR = "#3a9d5d"
LOWEST_MM = -0.4
MOMENTS = ("o", 5, "entry"), ("D", 4.5, "half the time"), ("*", 8, "hit")
"""Marker, its size [pt] and label at the start, middle and end of normalised time."""


def alignment_figure(traces: Traces, titles: dict[str, str], note: str) -> Figure | None:
    """Draw theta over normalised time: median and interquartile range of the participants."""
    if not traces.hits:
        return None
    figure = new_figure(ONE_COLUMN_MM, 62, note)
    axes = figure.subplots()
    if traces.zones.aligned_deg is not None:
        _draw_cone(axes, traces.zones.aligned_deg)
    medians: list[Line2D] = []
    for condition, style in condition_styles(titles).items():
        people = traces.by_participant(condition, "theta_deg")
        if not len(people):
            continue
        low, median, high = np.nanpercentile(people, (25, 50, 75), axis=0)
        axes.fill_between(100 * GRID, low, high, color=style.color, alpha=0.16, linewidth=0)
        label = f"{titles[condition]} (n = {len(people)})"
        medians += axes.plot(100 * GRID, median, style.line, color=style.color, linewidth=1.4, label=label)
    axes.set(xlabel="share of the run (%)", ylabel="theta (°)", xlim=(0, 100), ylim=(0, None))
    declutter(axes)
    legend_below(figure, medians)
    return figure


def cone_figure(traces: Traces, titles: dict[str, str], note: str) -> Figure | None:
    """Draw depth against theta, one panel per condition; the background shows the procedure's states."""
    shown = [condition for condition in titles if traces.of(condition)]
    if not shown:
        return None
    figure = new_figure(TWO_COLUMNS_MM if len(shown) > 1 else ONE_COLUMN_MM, 78, note)
    panels = np.ravel(figure.subplots(1, len(shown), sharex=True, sharey=True))
    widest = max(float(np.nanmax(run.theta_deg)) for run in traces.hits)
    farthest = max(float(np.nanmax(run.distance_mm)) for run in traces.hits)
    least_deg = 3 * (traces.zones.aligned_deg or 0.0)  # room for the names of both sides
    limits = (max(min(widest * 1.03, 40.0), least_deg), farthest * 1.03)
    styles = condition_styles(titles)
    for axes, condition in zip(panels, shown, strict=True):
        _draw_zones(axes, traces.zones, limits)
        _draw_paths(axes, traces, condition, styles[condition])
        axes.set_title(wrapped(titles[condition], 150 / len(shown)), pad=11)
        axes.set(xlabel="theta (°)", xlim=(0, limits[0]), ylim=(LOWEST_MM, limits[1]))
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("distance to the retina (mm)")
    handles = [
        Line2D([], [], color=INK, linewidth=0.6, label="a run"),
        Line2D([], [], color=INK, linewidth=1.6, label="median"),
    ]
    handles += [
        Line2D([], [], color=INK, marker=marker, markersize=size, linewidth=0, label=label)
        for marker, size, label in MOMENTS
    ]
    legend_below(figure, handles)
    return figure


def _draw_cone(axes: "Axes", aligned_deg: float) -> None:
    axes.axhspan(0, aligned_deg, color=CONE_COLOR, alpha=0.18, linewidth=0)
    axes.axhline(aligned_deg, color=CONE_COLOR, linewidth=0.9)
    label = f"aligned up to {aligned_deg:g}°"
    transform = axes.get_yaxis_transform()
    axes.text(0.015, aligned_deg, label, transform=transform, va="bottom", fontsize=SMALL_PT, color="#256b3f")


def _draw_zones(axes: "Axes", zones: Zones, limits: tuple[float, float]) -> None:
    if zones.aligned_deg is None or zones.touching_mm is None or zones.approaching_mm is None:
        return
    cone = (0.0, zones.aligned_deg), (zones.aligned_deg, limits[0])
    for (left, right), aligned in zip(cone, ("aligned", "misaligned"), strict=True):
        for top, bottom, state in (
            (zones.approaching_mm, limits[1], f"{aligned}_intraocular_navigation"),
            (zones.touching_mm, zones.approaching_mm, f"{aligned}_retinal_approach"),
            (LOWEST_MM, zones.touching_mm, "target_hit" if aligned == "aligned" else "retinal_contact"),
        ):
            color = paint_of(state).color
            axes.fill_between((left, right), top, bottom, color=color, alpha=0.45, linewidth=0)
    axes.axvline(zones.aligned_deg, color=INK, linewidth=1.1)
    for top_mm in (zones.approaching_mm, zones.touching_mm):
        axes.axhline(top_mm, color=INK, linewidth=0.7, linestyle=":")
    bands = (zones.approaching_mm, "navigation"), (zones.touching_mm, "approach"), (LOWEST_MM, "contact")
    for bottom_mm, name in bands:
        axes.annotate(
            name, (0.985, bottom_mm), (0, 2), xycoords=axes.get_yaxis_transform(), textcoords="offset points",
            ha="right", va="bottom", fontsize=SMALL_PT, color=QUIET_INK,
        )  # fmt: skip
    middle: dict[str, Any] = {"va": "bottom", "ha": "center", "fontsize": SMALL_PT, "color": QUIET_INK}
    axes.text(zones.aligned_deg / 2, limits[1], "aligned", **middle)
    axes.text((zones.aligned_deg + limits[0]) / 2, limits[1], "misaligned", **middle)


def _draw_paths(axes: "Axes", traces: Traces, condition: str, style: ConditionStyle) -> None:
    for run in traces.of(condition):
        axes.plot(run.theta_deg, run.distance_mm, color=INK, linewidth=0.4, alpha=0.35)
    theta_deg = np.nanmedian(traces.by_participant(condition, "theta_deg"), axis=0)
    distance_mm = np.nanmedian(traces.by_participant(condition, "distance_mm"), axis=0)
    axes.plot(theta_deg, distance_mm, color="white", linewidth=3)
    axes.plot(theta_deg, distance_mm, style.line, color=style.color, linewidth=1.6)
    for share, (marker, size, _) in zip((0, len(GRID) // 2, -1), MOMENTS, strict=True):
        axes.plot(
            theta_deg[share], distance_mm[share], marker,
            color=style.color, markeredgecolor="white", markeredgewidth=0.5, markersize=size, zorder=4,
        )  # fmt: skip
