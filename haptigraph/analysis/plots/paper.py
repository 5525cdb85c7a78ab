"""Style of figures for papers: sizes, panel letters, scale bars, colours, reproducible files.

Sizes are those of print: one column is 89 mm wide, two are 183 mm. Fonts are embedded in PDF (TrueType), and
drawn as outlines in SVG.
"""

from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from haptigraph.analysis.evaluation.sweep_figure import check_output
from haptigraph.errors import BadInput
from haptigraph.figures import Figure, rc_context, withStroke

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = [
    "COLORS", "DASHES", "STYLE", "UNDATED", "WIDTH_IN", "check_new", "letter", "save", "scale_bar", "styled",
]  # fmt: skip

WIDTH_IN = 183 / 25.4
COLORS = {
    "orange": "#e69f00", "sky": "#56b4e9", "green": "#009e73", "yellow": "#f0e442", "blue": "#0072b2",
    "red": "#d55e00", "purple": "#cc79a7", "black": "#000000", "grey": "#6b6b6b",
}  # fmt: skip
"""The palette of Okabe and Ito, which people with colour-vision deficiency can distinguish."""
DASHES: tuple[Any, ...] = ("-", (0, (1, 1.2)), (0, (4, 1.5)), (0, (4, 1.2, 1, 1.2)))
"""Line styles, so that no curve is known by its colour alone."""
STYLE: dict[Any, Any] = {
    "font.size": 7,
    "axes.titlesize": 7,
    "axes.labelsize": 7,
    "xtick.labelsize": 6.5,
    "ytick.labelsize": 6.5,
    "legend.fontsize": 6,
    "legend.frameon": False,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.0,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "svg.hashsalt": "haptigraph",  # names of clip paths
    "pdf.fonttype": 42,
}
UNDATED: dict[str, dict[str, str | None]] = {
    "png": {"Software": None},
    "svg": {"Date": None},
    "pdf": {"CreationDate": None},
}
"""Metadata that would make the same figure another file each time, by format."""


def styled() -> AbstractContextManager[None]:
    """Return the matplotlib context of the figures."""
    return rc_context(STYLE)


def check_new(output: str | Path) -> Path:
    """Refuse a figure that exists or cannot be written, before the work for it begins.

    Raises:
        BadInput: If it exists, its folder does not, or its format is unknown.
    """
    path = Path(output)
    check_output(path)
    if path.exists():
        raise BadInput("exists already; delete it or give another name", path)
    return path


def save(figure: Figure, output: Path) -> None:
    """Write a figure; call it within `styled`.

    Raises:
        BadInput: If it cannot be written.
    """
    try:
        figure.savefig(output, dpi=300, facecolor="white", metadata=UNDATED[output.suffix[1:]])
    except OSError as error:  # that of a full disk does not name the file
        raise BadInput(f"cannot be written ({error.strerror})", output) from None


def letter(axes: "Axes", name: str, title: str) -> None:
    """Give a panel its letter, in bold, and its title."""
    axes.set_title(rf"$\bf{{{name}}}$  {title}", loc="left", pad=3)


def scale_bar(
    axes: "Axes",
    length_px: float,
    label: str,
    color: str = "white",
    *,
    down: bool = False,
    size_pt: float = 6.0,
) -> None:
    """Draw a scale bar into a corner of a picture.

    Args:
        axes: The picture's; its limits are settled.
        length_px: In the picture's own pixels.
        label: What it stands for: "5 mm".
        color: Of bar and label.
        down: Whether the bar runs along y, in the lower right corner, else along x in the lower left one.
        size_pt: Of the label.
    """
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    outline = [withStroke(linewidth=1.6, foreground="black" if color == "white" else "white")]
    text: dict[str, Any] = {"color": color, "fontsize": size_pt, "path_effects": outline}
    line: dict[str, Any] = {
        "color": color,
        "linewidth": 1.8,
        "solid_capstyle": "butt",
        "path_effects": outline,
    }
    if down:
        x, y = left + 0.9 * (right - left), bottom + 0.06 * (top - bottom)
        end = y + length_px * (1 if top > bottom else -1)
        axes.plot([x, x], [y, end], **line)
        axes.text(
            x - 0.04 * (right - left), (y + end) / 2, label, ha="right", va="center", rotation=90, **text
        )
        return
    x, y = left + 0.06 * (right - left), bottom + 0.06 * (top - bottom)
    axes.plot([x, x + length_px], [y, y], **line)
    axes.text(x, y + 0.03 * (top - bottom), label, ha="left", va="bottom", **text)
