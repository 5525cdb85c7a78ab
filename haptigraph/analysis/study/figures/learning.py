"""Learning curves: a measure over the trials of the session, by condition and its position."""

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from haptigraph.analysis.study.figures.raincloud import primary_quantities
from haptigraph.analysis.study.figures.style import (
    ONE_COLUMN_MM,
    QUIET_INK,
    SMALL_PT,
    TWO_COLUMNS_MM,
    ConditionStyle,
    condition_styles,
    declutter,
    legend_below,
    new_figure,
)
from haptigraph.analysis.study.quantities import Quantity
from haptigraph.analysis.study.results import StudyResults
from haptigraph.figures import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["MIN_MEDIAN_N", "learning_figure", "session_places"]

SHIFT = 0.14
"""Distance of the medians of two conditions, in trials."""
MIN_MEDIAN_N = 3
LABEL_MM, POSITION_MM = 4.0, 28.0
"""Room of a trial's number, and of "second condition"."""
PALE: dict[str, Any] = {"linewidth": 0.5, "markersize": 1.8, "alpha": 0.35}
"""Participants behind the medians."""
ALONE: dict[str, Any] = {"linewidth": 1.0, "markersize": 3.5, "alpha": 0.8}
"""Participants who are too few for medians."""
ORDINALS = {1: "first", 2: "second", 3: "third"}


def learning_figure(results: StudyResults, note: str) -> Figure | None:
    """Draw the primary measures of the runs over the session; None if everyone has one run.

    Each condition has a column of panels. Where it has one run per participant, all share one panel, and
    lines join a participant's conditions.
    """
    placed = session_places(results.runs)
    quantities = [each for each in primary_quantities(results) if each.name in placed]
    if not quantities or placed["place"].nunique() < 2:
        return None
    styles = condition_styles(results.conditions)
    has_medians = bool(placed.groupby(["condition", "place"]).size().max() >= MIN_MEDIAN_N)
    if placed["number"].max() == 1:
        columns, shares = len(quantities), [styles]
        figure = new_figure(TWO_COLUMNS_MM if columns > 1 else ONE_COLUMN_MM, 62, note)
        panels = figure.subplots(1, columns, squeeze=False).T
    else:
        columns, shares = len(styles), [{name: style} for name, style in styles.items()]
        figure = new_figure(TWO_COLUMNS_MM, 12 + 46 * len(quantities), note)
        panels = figure.subplots(len(quantities), columns, squeeze=False, sharey="row")
    for row, quantity in zip(panels, quantities, strict=True):
        for axes, share in zip(row, shares, strict=True):
            _draw(axes, placed, quantity, share, has_medians=has_medians)
            _label_session(axes, placed, 25.4 * figure.get_figwidth() / columns)
        row[0].set_ylabel(quantity.title)
    has_lines = has_medians or placed["number"].max() > 1
    handles = [
        axes.plot(
            [], [], color=style.color, linestyle=style.line if has_lines else "", marker=style.marker,
            label=results.title_of(name), **({} if has_medians else ALONE),
        )[0]
        for name, style in styles.items()
    ]  # fmt: skip
    legend_below(figure, handles)
    return figure


def session_places(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the runs with their place on the axis of the session, and their number under the condition.

    Args:
        runs: The analysed runs.

    Returns:
        The runs by participant and place, with `number` (from 1) and `place`; conditions are set apart.
    """
    keys = [key for key in ("position", "block", "trial") if key in runs]
    steps = runs[keys].drop_duplicates().sort_values(keys, ignore_index=True)
    steps["number"] = steps.groupby("position").cumcount() + 1
    steps["place"] = steps.index + 0.6 * (steps["position"].rank(method="dense") - 1)
    return runs.merge(steps, on=keys).sort_values(["participant", "place"])


def _draw(
    axes: "Axes",
    placed: pd.DataFrame,
    quantity: Quantity,
    styles: dict[str, ConditionStyle],
    *,
    has_medians: bool,
) -> None:
    people = PALE if has_medians else ALONE
    shown = placed[placed["condition"].isin(list(styles))].dropna(subset=[quantity.name])
    for _, person in shown.groupby("participant"):
        parts = [part for _, part in person.groupby("position")]
        for part in parts:
            style = styles[part["condition"].iloc[0]]
            _line(
                axes, part, quantity, color=style.color, linestyle=style.line, marker=style.marker, **people
            )
        for before, after in pairwise(parts):
            link = pd.concat([before.tail(1), after.head(1)])
            _line(axes, link, quantity, color="#a0a0a0", linestyle="-", **PALE)
    for number, (condition, style) in enumerate(styles.items()):
        aside = SHIFT * (number - (len(styles) - 1) / 2)
        _draw_medians(axes, shown[shown["condition"] == condition], quantity, aside, style)
    declutter(axes)


def _line(axes: "Axes", runs: pd.DataFrame, quantity: Quantity, **style: Any) -> None:
    axes.plot(
        runs["place"],
        runs[quantity.name],
        markeredgewidth=0,
        zorder=1.5,
        **style,
    )


def _draw_medians(
    axes: "Axes", runs: pd.DataFrame, quantity: Quantity, aside: float, style: ConditionStyle
) -> None:
    """Draw a line per position of the condition, over the trials of at least `MIN_MEDIAN_N` participants."""
    enough = runs.groupby("place")["place"].transform("size") >= MIN_MEDIAN_N
    for _, here in runs[enough].groupby("position"):
        quartiles = here.groupby("place")[quantity.name].quantile([0.25, 0.5, 0.75]).unstack()
        low, median, high = quartiles.to_numpy(float).T
        axes.errorbar(
            quartiles.index.to_numpy(float) + aside, median, (median - low, high - median),
            color=style.color, linestyle=style.line, marker=style.marker, linewidth=1.4, markersize=3.5,
            elinewidth=0.9, capsize=1.8, zorder=3,
        )  # fmt: skip


def _label_session(axes: "Axes", placed: pd.DataFrame, width_mm: float) -> None:
    """Label the trials below, and above them the position of their condition, if there are several."""
    steps = placed[["position", "number", "place"]].drop_duplicates()
    stride = max(1, int(np.ceil(len(steps) * LABEL_MM / width_mm)))
    shown = steps[(steps["number"] - 1) % stride == 0]
    axes.set_xticks(shown["place"].to_numpy(float), [str(number) for number in shown["number"]])
    axes.set_xlim(steps["place"].min() - 0.5, steps["place"].max() + 0.5)
    axes.set_xlabel("trial")
    middles = steps.groupby("position")["place"].mean()
    noun = " condition" if width_mm > POSITION_MM * len(middles) else ""
    for position, middle in middles.items() if len(middles) > 1 else ():
        axes.annotate(
            ORDINALS.get(int(position), f"{position:g}th") + noun, (middle, 1), (0, 2),
            xycoords=axes.get_xaxis_transform(), textcoords="offset points",
            ha="center", va="bottom", fontsize=SMALL_PT, color=QUIET_INK,
        )  # fmt: skip
