"""How a study's figures look, and how they are written: the same bytes for the same data."""

import io
from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from haptigraph.analysis.study.quantities import words

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["FORMATS", "INK", "Look", "condition_legend", "looks", "new_figure", "quiet", "rendered", "styled"]

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
UNDATED: dict[str, dict[str, str | None]] = {
    "png": {"Software": None},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}


class Look:
    """How one condition is told from the others, also without colour."""

    def __init__(self, color: str, line: str, marker: str, hatch: str) -> None:
        self.color, self.line, self.marker, self.hatch = color, line, marker, hatch


LOOKS = (
    Look("#4d4d4d", "--", "o", ""),
    Look("#7b2d8b", "-", "s", "////"),
    Look("#00695c", "-.", "^", "...."),
    Look("#8a5a00", ":", "D", "xxxx"),
)


def looks(conditions: Sequence[str]) -> dict[str, Look]:
    """Return the look of every condition."""
    return {name: LOOKS[number % len(LOOKS)] for number, name in enumerate(conditions)}


def styled() -> AbstractContextManager[None]:
    """Return the context in which the figures are drawn."""
    return rc_context(STYLE)


def new_figure(width: float, height: float, title: str, note: str) -> Figure:
    """Return an empty figure.

    Args:
        width: Inches.
        height: Inches.
        title: What it shows.
        note: What must stand on it, such as that it was simulated.
    """
    figure = Figure(figsize=(width, height), layout="constrained")
    figure.suptitle(f"{title}   [{note}]" if note else title, fontsize=11, color=INK)
    return figure


def quiet(axes: "Axes") -> None:
    """Leave out what carries nothing."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color="#e3e3e3", linewidth=0.7)
    axes.set_axisbelow(True)


def condition_legend(axes: "Axes", conditions: Sequence[str], **where: Any) -> None:
    """Name the conditions of a box plot."""
    patches = [
        Patch(facecolor="white", edgecolor=look.color, hatch=look.hatch, label=words(name))
        for name, look in looks(conditions).items()
    ]
    axes.legend(handles=patches, frameon=False, **where)


def rendered(figure: Figure) -> dict[str, bytes]:
    """Return a figure in every format, free of dates and of names made by chance."""
    drawn = {}
    with styled():
        for ending in FORMATS:
            buffer = io.BytesIO()
            figure.savefig(buffer, format=ending, dpi=160, facecolor="white", metadata=UNDATED[ending])
            drawn[ending] = buffer.getvalue()
    return drawn
