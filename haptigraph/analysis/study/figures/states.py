"""Figures of surgical states by condition: time in each state, and transitions."""

from collections import Counter
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from haptigraph.analysis.study.figures.style import (
    INK,
    ONE_COLUMN_MM,
    QUIET_INK,
    SMALL_PT,
    TWO_COLUMNS_MM,
    condition_legend,
    condition_styles,
    declutter,
    draw_box,
    new_figure,
    paint_of,
    wrapped,
)
from haptigraph.analysis.study.quantities import state_of, words
from haptigraph.analysis.study.results import StudyResults
from haptigraph.figures import FancyArrowPatch, FancyBboxPatch, Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from numpy.typing import NDArray

    _Vector = NDArray[np.float64]

__all__ = ["MIN_RATE", "POINT", "box_figure", "sequence_figure", "transitions"]

PLACES = {
    "misaligned_intraocular_navigation": (1.0, 1.0),
    "aligned_intraocular_navigation": (1.0, 0.0),
    "misaligned_retinal_approach": (2.0, 1.0),
    "aligned_retinal_approach": (2.0, 0.0),
    "retinal_contact": (3.0, 1.0),
    "target_hit": (3.0, 0.0),
}
"""Depth increases to the right; misaligned states are above."""
CONTACT = "retinal_contact"
START = "start"
BOX = (0.66, 0.38)
POINT: dict[str, Any] = {
    "color": INK, "alpha": 0.65, "markersize": 2.2, "markeredgewidth": 0, "linewidth": 0, "clip_on": False,
    "zorder": 4,
}  # fmt: skip
MIN_RATE = 0.05
"""Transitions per run below which no line is drawn, except for retinal contacts."""


def box_figure(results: StudyResults, note: str) -> Figure | None:
    """Draw the time spent in each state, by condition, with one point per participant; None without data."""
    order = list(PLACES)
    names = [name for name in results.values if state_of(name) and state_of(name) not in results.idle]
    names.sort(key=lambda name: order.index(state_of(name)) if state_of(name) in order else len(order))
    if not names:
        return None
    figure = new_figure(TWO_COLUMNS_MM, 70, note)
    axes = figure.subplots()
    styles, spread = condition_styles(results.conditions), 0.76 / len(results.conditions)
    for place, name in enumerate(names):
        axes.axvspan(place - 0.5, place + 0.5, color=paint_of(state_of(name)).color, alpha=0.6, linewidth=0)
        for number, condition in enumerate(results.conditions):
            values = results.values[name][condition].dropna().to_numpy(float)
            at = place + (number - (len(results.conditions) - 1) / 2) * spread
            style = styles[condition]
            draw_box(axes, values, at, 0.82 * spread, style)
            aside = np.linspace(-0.22, 0.22, max(len(values), 2))[: len(values)] * spread
            axes.plot(at + aside, values, style.marker, **POINT)
    labels = [wrapped(words(state_of(name)), 160 / len(names)) for name in names]
    axes.set(xlim=(-0.5, len(names) - 0.5), ylim=(0, None), ylabel="time (s)")
    axes.set_xticks(range(len(names)), labels)
    declutter(axes)
    condition_legend(figure, results.titles)
    return figure


def transitions(results: StudyResults) -> pd.DataFrame:
    """Count the transitions between states; the first state of a run follows `start`.

    Returns:
        condition, before, after, count, per_run (mean), share (of the runs in which it occurred), runs; by
        descending frequency.
    """
    rows: list[tuple[str, str, str, int, float, float, int]] = []
    for condition in results.conditions:
        runs = results.runs
        orders = (
            runs.loc[runs["condition"] == condition, "state_order"].dropna() if "state_order" in runs else []
        )
        counts, within = Counter[tuple[str, str]](), Counter[tuple[str, str]]()
        for order in orders:
            states = [START, *str(order).split(">")]
            steps = list(pairwise(states))
            counts.update(steps)
            within.update(set(steps))
        total = len(orders)
        for pair, count in sorted(counts.items(), key=lambda item: (-item[1], item[0])):
            rows.append((condition, *pair, count, count / total, within[pair] / total, total))
    columns = ["condition", "before", "after", "count", "per_run", "share", "runs"]
    return pd.DataFrame(rows, columns=columns)


def sequence_figure(results: StudyResults, note: str) -> Figure | None:
    """Draw the transitions between states, one diagram per condition; None without data.

    Line width is proportional to frequency; transitions in at least half of the runs are dark.
    """
    table = transitions(results)
    if table.empty:
        return None
    shown = [condition for condition in results.conditions if (table["condition"] == condition).any()]
    places = _places(set(table["before"]) | set(table["after"]))
    rows = 2.0 - min(y for _, y in places.values())
    figure = new_figure(ONE_COLUMN_MM, 26 * rows * len(shown), note)
    max_rate = float(table["per_run"].max())
    for axes, condition in zip(np.ravel(figure.subplots(len(shown), 1)), shown, strict=True):
        here = table[table["condition"] == condition]
        _draw_sequence(axes, here, places, max_rate)
        title = f"{results.title_of(condition)}  ({here['runs'].iloc[0]} runs)"
        axes.set_title(title, loc="left", fontweight="bold", pad=2)
    return figure


def _places(states: set[str]) -> dict[str, tuple[float, float]]:
    others = sorted(states - set(PLACES) - {START})
    below = {state: (1.0 + number % 3, -1.0 - number // 3) for number, state in enumerate(others)}
    return {START: (0.22, 1.0), **PLACES, **below}


def _draw_sequence(
    axes: "Axes", table: pd.DataFrame, places: dict[str, tuple[float, float]], max_rate: float
) -> None:
    axes.set(xlim=(0.1, 3.0 + BOX[0] / 2 + 0.05), ylim=(min(y for _, y in places.values()) - 0.25, 1.25))
    axes.axis("off")
    reached = set(table["before"]) | set(table["after"])
    axes.plot(*places[START], "o", color=INK, markersize=6, zorder=3)
    axes.text(places[START][0], places[START][1] + 0.12, "entry", ha="center", va="bottom", fontsize=SMALL_PT)
    for state, place in places.items():
        if state != START:
            _draw_state(axes, state, place, reached=state in reached)
    for row in table[::-1].to_dict("records"):
        before, after = str(row["before"]), str(row["after"])
        if row["per_run"] >= MIN_RATE or CONTACT in (before, after):
            arrow = _arrow(places[before], places[after])
            _draw_transition(axes, arrow, row["per_run"], max_rate, is_common=row["share"] >= 0.5)


def _draw_state(axes: "Axes", state: str, place: tuple[float, float], *, reached: bool) -> None:
    corner = place[0] - BOX[0] / 2, place[1] - BOX[1] / 2
    box = FancyBboxPatch(
        corner,
        *BOX,
        boxstyle="round,pad=0,rounding_size=0.05",
        facecolor=paint_of(state).color,
        edgecolor=INK if reached else "#bbbbbb",
        linewidth=1.0,
        alpha=1.0 if reached else 0.3,
        zorder=3,
    )
    axes.add_patch(box)
    ink = paint_of(state).ink if reached else "#666666"
    axes.text(
        *place,
        words(state).replace(" ", "\n"),
        ha="center",
        va="center",
        fontsize=SMALL_PT,
        color=ink,
        zorder=4,
    )


def _draw_transition(axes: "Axes", arrow: "_Arrow", rate: float, max_rate: float, *, is_common: bool) -> None:
    linewidth = 0.5 + 3 * rate / max_rate
    patch = FancyArrowPatch(
        arrow.tail,
        arrow.head,
        arrowstyle="-|>",
        mutation_scale=5 + 3 * rate / max_rate,
        linewidth=linewidth,
        linestyle="-" if is_common else (0, (3, 1.5)),
        color=INK if is_common else "#8a8a8a",
        shrinkA=0,
        shrinkB=0,
        zorder=2,
    )
    axes.add_patch(patch)
    ink, weight = (INK, "bold") if is_common else (QUIET_INK, "normal")
    aside, up = (round(part) for part in arrow.left)
    away_pt = 2.0 + linewidth / 2
    axes.annotate(
        f"{rate:.2f}", arrow.label, (away_pt * arrow.left[0], away_pt * arrow.left[1]),
        textcoords="offset points",
        ha=("center", "left", "right")[aside], va=("center", "bottom", "top")[up],
        fontsize=SMALL_PT, color=ink, fontweight=weight, zorder=5,
    )  # fmt: skip


class _Arrow(NamedTuple):
    tail: tuple[float, float]
    head: tuple[float, float]
    label: tuple[float, float]
    """The point on the arrow that has the label."""
    left: tuple[float, float]
    """The direction to its left, where the label is, outside a pair of arrows."""


def _arrow(start: tuple[float, float], end: tuple[float, float]) -> _Arrow:
    """Return the arrow between the edges of two boxes, shifted to its left to clear the reverse arrow."""
    is_entry = start[0] < 1
    towards = np.subtract(end, start)
    length = float(np.hypot(*towards)) or 1.0
    left = np.array((-towards[1], towards[0])) / length
    aside = left * np.array((0.07, 0.07)) * (not is_entry)
    tail = np.add(start, aside) + (0.05 if is_entry else _to_edge(aside, towards)) * towards
    head = np.add(end, aside) - _to_edge(aside, -towards) * towards
    label = tail + (0.66 if towards[0] and towards[1] else 0.45) * (head - tail)
    return _Arrow(*((float(x), float(y)) for x, y in (tail, head, label, left)))


def _to_edge(aside: "_Vector", towards: "_Vector") -> float:
    """Return the share of `towards` from a point next to a box's centre to its edge."""
    halves = np.array((BOX[0] / 2, BOX[1] / 2))
    shares = [
        (half * np.sign(part) - off) / part
        for half, off, part in zip(halves, aside, towards, strict=True)
        if part
    ]
    return float(min(shares, default=0.0))
