"""Style and export of a report's figures; equal data give equal bytes."""

import io
from collections.abc import Iterable
from contextlib import AbstractContextManager
from functools import cache
from typing import TYPE_CHECKING, Any

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from haptigraph.analysis.plots.paper import UNDATED
from haptigraph.assemble import load_procedure, procedure_names
from haptigraph.inference.colors import PAPER_PALETTE, Paint, palette

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from haptigraph.analysis.study.traces import Floats

__all__ = [
    "FORMATS", "INK", "ConditionStyle", "condition_legend", "condition_styles", "declutter", "draw_box",
    "new_figure",
    "paint_of", "rendered", "styled",
]  # fmt: skip

FORMATS = ("png", "svg", "pdf")
INK = "#222222"
STYLE: dict[Any, Any] = {
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.edgecolor": "#555555",
    "axes.linewidth": 0.8,
    "hatch.linewidth": 0.7,
    "svg.hashsalt": "haptigraph",  # names of clip paths
    "pdf.fonttype": 42,
}
UNKNOWN_PAINT = Paint("#e4e4e4", "#000000")


def paint_of(state: str) -> Paint:
    """Return the paint of a state of a shipped procedure; grey for others, because tables have no kinds."""
    return _paints().get(state, UNKNOWN_PAINT)


@cache
def _paints() -> dict[str, Paint]:
    paints: dict[str, Paint] = {}
    for name in procedure_names():
        paints |= palette(load_procedure(name))
    return paints | PAPER_PALETTE


class ConditionStyle:
    """Colour, line, marker and hatch of one condition, which is identifiable without colour."""

    def __init__(self, color: str, line: str, marker: str, hatch: str) -> None:
        self.color, self.line, self.marker, self.hatch = color, line, marker, hatch


STYLES = (
    ConditionStyle("#4d4d4d", "--", "o", ""),
    ConditionStyle("#7b2d8b", "-", "s", "////"),
    ConditionStyle("#00695c", "-.", "^", "...."),
    ConditionStyle("#8a5a00", ":", "D", "xxxx"),
)


def condition_styles(conditions: Iterable[str]) -> dict[str, ConditionStyle]:
    """Return the style of every condition."""
    return {name: STYLES[number % len(STYLES)] for number, name in enumerate(conditions)}


def styled() -> AbstractContextManager[None]:
    """Return the matplotlib context of the figures."""
    return rc_context(STYLE)


def new_figure(width: float, height: float, title: str, note: str) -> Figure:
    """Return an empty figure.

    Args:
        width: Inches.
        height: Inches.
        title: The title.
        note: Appended to the title, such as that the data are simulated.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    figure.suptitle(f"{title}   [{note}]" if note else title, fontsize=11, color=INK)
    return figure


def draw_box(axes: "Axes", values: "Floats", x: float, width: float, style: ConditionStyle) -> None:
    """Draw quartiles, and whiskers of 1.5 times the interquartile range, in the style of a condition."""
    axes.boxplot(
        [values],
        positions=[x],
        widths=width,
        patch_artist=True,
        showfliers=False,
        boxprops={"facecolor": "white", "edgecolor": style.color, "hatch": style.hatch},
        whiskerprops={"color": style.color},
        capprops={"color": style.color},
        medianprops={"color": "black", "linewidth": 2},
        manage_ticks=False,
    )


def declutter(axes: "Axes") -> None:
    """Remove spines and add a light grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color="#e3e3e3", linewidth=0.7)
    axes.set_axisbelow(True)


def condition_legend(axes: "Axes", titles: dict[str, str], **where: Any) -> None:
    """Add a legend of the conditions to a box plot; titles are by name."""
    patches = [
        Patch(facecolor="white", edgecolor=style.color, hatch=style.hatch, label=titles[name])
        for name, style in condition_styles(titles).items()
    ]
    axes.legend(handles=patches, frameon=False, **where)


def rendered(figure: Figure) -> dict[str, bytes]:
    """Return a figure in every format, without dates and random identifiers."""
    drawn = {}
    with styled():
        for ending in FORMATS:
            buffer = io.BytesIO()
            figure.savefig(buffer, format=ending, dpi=160, facecolor="white", metadata=UNDATED[ending])
            drawn[ending] = buffer.getvalue()
    return drawn
