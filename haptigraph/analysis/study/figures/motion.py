"""Figures of motion: alignment over normalised time, depth against theta, and learning."""

from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from scipy import stats

from haptigraph.analysis.study.figures.style import (
    INK,
    ConditionStyle,
    condition_styles,
    declutter,
    new_figure,
    paint_of,
)
from haptigraph.analysis.study.quantities import QUANTITIES, Quantity
from haptigraph.analysis.study.results import StudyResults
from haptigraph.analysis.study.traces import GRID, Traces, Zones

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["alignment_figure", "cone_figure", "learning_figure"]

CONE_COLOR = "#3a9d5d"
LOWEST_MM = -0.4


def alignment_figure(traces: Traces, titles: dict[str, str], note: str) -> Figure | None:
    """Draw theta over normalised time: median and interquartile range of the participants."""
    if not traces.runs:
        return None
    figure = new_figure(6.4, 3.9, "Alignment from entry to hit", note)
    axes = figure.subplots()
    if traces.zones.aligned_deg is not None:
        _draw_cone(axes, traces.zones.aligned_deg, (0.01, 0.99))
    for condition, style in condition_styles(titles).items():
        people = traces.by_participant(condition, "theta_deg")
        if not len(people):
            continue
        low, median, high = np.nanpercentile(people, (25, 50, 75), axis=0)
        axes.fill_between(100 * GRID, low, high, color=style.color, alpha=0.16, linewidth=0)
        label = f"{titles[condition]} (median and quartiles of {len(people)} participants)"
        axes.plot(100 * GRID, median, style.line, color=style.color, linewidth=2, label=label)
    axes.set(xlabel="share of the run [%]", ylabel="theta [deg]", xlim=(0, 100), ylim=(0, None))
    declutter(axes)
    axes.legend(frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.16))
    return figure


def cone_figure(traces: Traces, titles: dict[str, str], note: str) -> Figure | None:
    """Draw depth against theta, one panel per condition; the background shows the procedure's states."""
    shown = [condition for condition in titles if traces.of(condition)]
    if not shown:
        return None
    figure = new_figure(3.9 * len(shown) + 0.6, 4.6, "Align, then approach: depth against theta", note)
    panels = np.ravel(figure.subplots(1, len(shown), sharex=True, sharey=True))
    widest = max(float(np.nanmax(run.theta_deg)) for run in traces.runs)
    farthest = max(float(np.nanmax(run.distance_mm)) for run in traces.runs)
    limits = (min(widest * 1.03, 40.0), farthest * 1.03)
    styles = condition_styles(titles)
    for axes, condition in zip(panels, shown, strict=True):
        _draw_zones(axes, traces.zones, limits)
        _draw_paths(axes, traces, condition, styles[condition])
        axes.set_title(titles[condition], pad=18)
        axes.set(xlabel="theta [deg]", xlim=(0, limits[0]), ylim=(LOWEST_MM, limits[1]))
        axes.spines[["top", "right"]].set_visible(False)
    panels[0].set_ylabel("distance to the retina [mm]")
    handles = [
        Line2D([], [], color=INK, linewidth=0.6, label="a run"),
        Line2D([], [], color=INK, linewidth=2.4, label="median"),
    ]
    handles += [
        Line2D([], [], color=INK, marker=marker, linewidth=0, label=label)
        for marker, label in (("o", "entry"), ("D", "half the time"), ("*", "hit"))
    ]
    figure.legend(handles=handles, frameon=False, loc="outside lower center", ncols=5, fontsize=8)
    return figure


def learning_figure(results: StudyResults, note: str) -> Figure | None:
    """Draw the paper's measures over the session, by the position of the condition."""
    runs = results.runs
    quantities = [each for each in QUANTITIES[:2] if each.name in results.values]
    if not quantities or runs[["position", "trial"]].drop_duplicates().shape[0] < 2:
        return None
    figure = new_figure(
        4.3 * len(quantities), 3.8, "Learning over the session (mean and 95 % interval)", note
    )
    panels = np.ravel(figure.subplots(1, len(quantities)))
    for axes, quantity in zip(panels, quantities, strict=True):
        _draw_learning(axes, results, quantity)
    count = len(results.conditions)
    figure.legend(
        *panels[0].get_legend_handles_labels(), frameon=False, loc="outside lower center", ncols=count
    )
    return figure


def _draw_cone(axes: "Axes", aligned_deg: float, place: tuple[float, float]) -> None:
    axes.axhspan(0, aligned_deg, color=CONE_COLOR, alpha=0.18, linewidth=0)
    axes.axhline(aligned_deg, color=CONE_COLOR, linewidth=0.9)
    where: dict[str, Any] = {
        "transform": axes.get_yaxis_transform(),
        "ha": "right",
        "va": "bottom",
        "fontsize": 8,
    }
    axes.text(place[1], aligned_deg, f"aligned below {aligned_deg:g} deg", color="#256b3f", **where)


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
    edge: dict[str, Any] = {
        "transform": axes.get_yaxis_transform(),
        "ha": "right",
        "va": "top",
        "fontsize": 8,
        "color": "#444444",
    }
    bands = (limits[1], "navigation"), (zones.approaching_mm, "approach"), (zones.touching_mm, "contact")
    for top_mm, name in bands:
        axes.axhline(top_mm, color=INK, linewidth=0.7, linestyle=":")
        axes.text(0.985, top_mm, name, **edge)
    middle: dict[str, Any] = {"va": "bottom", "ha": "center", "fontsize": 8, "color": "#444444"}
    axes.text(zones.aligned_deg / 2, limits[1], "aligned", **middle)
    axes.text((zones.aligned_deg + limits[0]) / 2, limits[1], "misaligned", **middle)


def _draw_paths(axes: "Axes", traces: Traces, condition: str, style: ConditionStyle) -> None:
    for run in traces.of(condition):
        axes.plot(run.theta_deg, run.distance_mm, color=INK, linewidth=0.6, alpha=0.35)
    theta_deg = np.nanmedian(traces.by_participant(condition, "theta_deg"), axis=0)
    distance_mm = np.nanmedian(traces.by_participant(condition, "distance_mm"), axis=0)
    axes.plot(theta_deg, distance_mm, color="white", linewidth=4.5)
    axes.plot(theta_deg, distance_mm, style.line, color=style.color, linewidth=2.4)
    for share, marker in ((0, "o"), (len(GRID) // 2, "D"), (-1, "*")):
        axes.plot(theta_deg[share], distance_mm[share], marker, color=style.color, mec="white", markersize=9)


def _draw_learning(axes: "Axes", results: StudyResults, quantity: Quantity) -> None:
    steps = sorted(set(zip(results.runs["position"], results.runs["trial"], strict=True)))
    place = {step: number + 0.6 * (step[0] - 1) for number, step in enumerate(steps)}
    shift = 0.12
    for number, (condition, style) in enumerate(condition_styles(results.conditions).items()):
        runs = results.runs[results.runs["condition"] == condition]
        for position in sorted(set(runs["position"])):
            here = runs[runs["position"] == position].dropna(subset=[quantity.name])
            groups = [(trial, each[quantity.name].to_numpy(float)) for trial, each in here.groupby("trial")]
            at = [place[position, trial] + shift * number for trial, _ in groups]
            means = [float(values.mean()) for _, values in groups]
            halves = [_half_interval(values) for _, values in groups]
            label = results.title_of(condition) if position == min(runs["position"]) else None
            errorbars: dict[str, Any] = {
                "color": style.color,
                "linestyle": style.line,
                "marker": style.marker,
                "capsize": 2.5,
            }
            axes.errorbar(at, means, halves, linewidth=1.6, markersize=5, label=label, **errorbars)
    axes.set_xticks([place[step] for step in steps], [f"{trial:g}" for _, trial in steps])
    for position in sorted({position for position, _ in steps}):
        middle = np.mean([at for step, at in place.items() if step[0] == position])
        where: dict[str, Any] = {
            "transform": axes.get_xaxis_transform(),
            "ha": "center",
            "va": "bottom",
            "fontsize": 8,
        }
        axes.text(float(middle), 1.0, f"{_ordinal(int(position))} condition", color="#555555", **where)
    axes.set(xlabel="trial", ylabel=quantity.title)
    declutter(axes)


def _ordinal(number: int) -> str:
    return {1: "first", 2: "second", 3: "third"}.get(number, f"{number}th")


def _half_interval(values: "np.ndarray[tuple[int], np.dtype[np.float64]]") -> float:
    """Return half the width of the 95 % interval of a mean (Student's t); 0 for a single value."""
    if len(values) < 2:
        return 0.0
    return float(stats.t.ppf(0.975, len(values) - 1) * stats.sem(values))
