"""Style and export of a report's figures, for one or two columns of print; equal data give equal bytes."""

import io
import textwrap
from collections.abc import Iterable, Sequence
from contextlib import AbstractContextManager
from functools import cache
from typing import TYPE_CHECKING, Any, Literal

from haptigraph.analysis.plots.paper import STYLE as PAPER_STYLE
from haptigraph.analysis.plots.paper import UNDATED
from haptigraph.assemble import load_procedure, procedure_names
from haptigraph.figures import Figure, Line2D, Patch, rc_context
from haptigraph.inference.colors import PAPER_PALETTE, Paint, palette

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from haptigraph.analysis.study.traces import Floats

__all__ = [
    "FORMATS", "INK", "ONE_COLUMN_MM", "QUIET_INK", "SMALL_PT", "TWO_COLUMNS_MM", "ConditionStyle",
    "condition_legend", "condition_styles", "declutter", "draw_box", "legend_below", "legend_rows",
    "new_figure", "paint_of", "rendered", "styled", "wrapped",
]  # fmt: skip

FORMATS = ("png", "svg", "pdf")
ONE_COLUMN_MM, TWO_COLUMNS_MM = 85.0, 177.0
"""The widths of ieeeconf, the narrowest of the usual two-column styles; a figure is printed at its size."""
SMALL_PT = 6.5
"""Font size of what is said beside the axes' labels; no text is smaller."""
LETTER_MM = 1.25
"""Average width of a letter of `SMALL_PT` in DejaVu Sans, generously."""
KEY_MM = 12.0
"""Width of a legend's key with the space around it."""
INK, QUIET_INK = "#222222", "#555555"
STYLE: dict[Any, Any] = {
    **PAPER_STYLE,
    "axes.edgecolor": QUIET_INK,
    "hatch.linewidth": 0.5,
    "legend.fontsize": SMALL_PT,
    "lines.markersize": 3,
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


def new_figure(width_mm: float, height_mm: float, note: str) -> Figure:
    """Return an empty figure without a title, which belongs into the caption.

    Args:
        width_mm: `ONE_COLUMN_MM` or `TWO_COLUMNS_MM`.
        height_mm: The height.
        note: A mark in the corner, such as that the data are simulated; may be empty.
    """
    figure = Figure(figsize=(width_mm / 25.4, height_mm / 25.4), layout="constrained")
    if note:
        figure.suptitle(note, x=0.995, ha="right", fontsize=SMALL_PT, fontweight="bold", color=INK)
    return figure


def wrapped(text: str, width_mm: float) -> str:
    """Break a text of `SMALL_PT` into lines of a width, at spaces only."""
    return textwrap.fill(text, max(1, int(width_mm / LETTER_MM)), break_long_words=False)


def draw_box(axes: "Axes", values: "Floats", x: float, width: float, style: ConditionStyle) -> None:
    """Draw quartiles, and whiskers of 1.5 times the interquartile range, in the style of a condition."""
    axes.boxplot(
        [values],
        positions=[x],
        widths=width,
        patch_artist=True,
        showfliers=False,
        boxprops={
            "facecolor": "white",
            "edgecolor": style.color,
            "hatch": style.hatch,
            "linewidth": 0.7,
        },
        whiskerprops={"color": style.color, "linewidth": 0.7},
        capprops={"color": style.color, "linewidth": 0.7},
        medianprops={"color": "black", "linewidth": 1.4},
        manage_ticks=False,
    )


def declutter(axes: "Axes") -> None:
    """Remove spines and add a light grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color="#e3e3e3", linewidth=0.5)
    axes.set_axisbelow(True)


def condition_legend(figure: Figure, titles: dict[str, str]) -> None:
    """Add a legend of the conditions below box plots; titles are by name."""
    patches = [
        Patch(facecolor="white", edgecolor=style.color, hatch=style.hatch, label=titles[name])
        for name, style in condition_styles(titles).items()
    ]
    legend_below(figure, patches)


def legend_below(
    figure: Figure,
    handles: Sequence[Patch | Line2D],
    where: Literal["outside lower center", "lower center"] = "outside lower center",
) -> None:
    """Add a legend below a figure, with as many columns as its width has room for."""
    rows = legend_rows(handles, 25.4 * figure.get_figwidth())
    figure.legend(handles=handles, loc=where, ncols=-(-len(handles) // rows))


def legend_rows(handles: Sequence[Patch | Line2D], width_mm: float) -> int:
    """Return the number of rows of a legend below a figure of some width."""
    longest = max(len(str(handle.get_label())) for handle in handles)
    return -(-len(handles) // max(1, int(width_mm / (LETTER_MM * longest + KEY_MM))))


def rendered(figure: Figure, formats: Sequence[str] = FORMATS) -> dict[str, bytes]:
    """Return a figure in formats, without dates and random identifiers."""
    drawn = {}
    with styled():
        if figure.get_layout_engine() is not None:
            figure.draw_without_rendering()
            figure.set_layout_engine("none")  # the layout is settled, for every format
        for ending in formats:
            buffer = io.BytesIO()
            figure.savefig(buffer, format=ending, dpi=300, facecolor="white", metadata=UNDATED[ending])
            drawn[ending] = buffer.getvalue()
    return drawn
