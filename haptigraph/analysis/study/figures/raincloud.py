"""Raincloud plots of the primary measures: density, box and points by condition, a line per participant."""

from typing import TYPE_CHECKING

import numpy as np
from scipy import stats

from haptigraph.analysis.study.figures.style import (
    ONE_COLUMN_MM,
    TWO_COLUMNS_MM,
    ConditionStyle,
    condition_styles,
    declutter,
    draw_box,
    new_figure,
    wrapped,
)
from haptigraph.analysis.study.quantities import Quantity
from haptigraph.analysis.study.results import StudyResults
from haptigraph.figures import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from haptigraph.analysis.study.traces import Floats

__all__ = ["JOINED", "MIN_DENSITY_N", "density", "primary_quantities", "raincloud_figure"]

MIN_DENSITY_N = 8
"""Number of values from which a density is drawn: that of fewer shows the bandwidth, not the values."""
JOINED = "#8a8a8a"
"""Colour of a participant's line."""
PANEL_MM = 62.0
POINTS, CLOUD = 0.12, 0.1
"""Distance from a condition's box to its points, on the inside, and to its density."""


def primary_quantities(results: StudyResults) -> list[Quantity]:
    """Return the primary measures that have values."""
    found = results.quantities.values()
    return [each for each in found if each.family == "primary" and each.name in results.values]


def raincloud_figure(results: StudyResults, note: str) -> Figure | None:
    """Draw the primary measures, one panel each: a point per participant, joined across the conditions."""
    quantities = primary_quantities(results)
    if not quantities:
        return None
    columns = min(len(quantities), 3 if len(results.conditions) == 2 else 2)
    rows = -(-len(quantities) // columns)
    width_mm = ONE_COLUMN_MM if columns == 1 else TWO_COLUMNS_MM
    figure = new_figure(width_mm, PANEL_MM * rows, note)
    panels = np.ravel(figure.subplots(rows, columns, squeeze=False))
    room_mm = (width_mm / columns - 14) / len(results.conditions)
    for axes, quantity in zip(panels, quantities, strict=False):
        _draw(axes, results, quantity, room_mm)
    for axes in panels[len(quantities) :]:
        axes.remove()
    return figure


def density(values: "Floats") -> "tuple[Floats, Floats] | None":
    """Estimate the density of values, within their range (Gaussian kernel, bandwidth by Scott's rule).

    Args:
        values: (n,)

    Returns:
        Where, (100,), and the density there, (100,); None of fewer than `MIN_DENSITY_N` or of equal values.
    """
    if len(values) < MIN_DENSITY_N or np.ptp(values) == 0:
        return None
    at = np.linspace(values.min(), values.max(), 100)
    return at, stats.gaussian_kde(values)(at)


def _draw(axes: "Axes", results: StudyResults, quantity: Quantity, room_mm: float) -> None:
    """Draw one measure; the densities of all conditions have the same scale."""
    table = results.values[quantity.name]
    samples = {condition: table[condition].dropna().to_numpy(float) for condition in results.conditions}
    clouds = {condition: density(values) for condition, values in samples.items()}
    highest = max((cloud[1].max() for cloud in clouds.values() if cloud is not None), default=1.0)
    sides = [-1, *[1] * (len(samples) - 1)]
    if results.is_within:
        places = np.arange(len(samples)) - POINTS * np.array(sides)
        axes.plot(places, table.to_numpy(float).T, color=JOINED, linewidth=0.5, alpha=0.7, zorder=1.5)
    labels = []
    for place, (condition, style) in enumerate(condition_styles(samples).items()):
        values, side = samples[condition], sides[place]
        labels.append(f"{wrapped(results.title_of(condition), room_mm)}\nn = {len(values)}")
        if not len(values):
            continue
        _draw_cloud(axes, clouds[condition], place + side * CLOUD, 0.32 * side / highest, style)
        draw_box(axes, values, place, 0.11, style)
        axes.plot(
            np.full(len(values), place - side * POINTS), values, style.marker,
            color=style.color, markeredgecolor="white", markeredgewidth=0.3, alpha=0.85, clip_on=False,
        )  # fmt: skip
    axes.set_xticks(range(len(samples)), labels)
    axes.set_xlim(-0.5, len(samples) - 0.5)
    axes.set_ylabel(quantity.title)
    declutter(axes)


def _draw_cloud(
    axes: "Axes", cloud: "tuple[Floats, Floats] | None", base: float, scale: float, style: ConditionStyle
) -> None:
    if cloud is None:
        return
    at, height = cloud
    axes.fill_betweenx(
        at,
        base,
        base + scale * height,
        facecolor="none",
        hatch=style.hatch,
        edgecolor=style.color,
        linewidth=0,
    )
    axes.fill_betweenx(at, base, base + scale * height, facecolor=style.color, alpha=0.3, linewidth=0)
    axes.plot(base + scale * height, at, style.line, color=style.color, linewidth=0.7)
