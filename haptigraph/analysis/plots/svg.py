"""Text and files of the SVGs that are drawn by hand, so that the same input gives the same bytes."""

from html import escape
from pathlib import Path

from haptigraph.errors import BadInput

__all__ = ["FONT", "INK", "text_svg", "write_svg"]

FONT = 'font-family="DejaVu Sans, Verdana, sans-serif"'
INK = "#222222"


def text_svg(
    x: float,
    y: float,
    text: str,
    *,
    size_px: float = 13.5,
    color: str = INK,
    weight: str = "normal",
    anchor: str = "middle",
) -> str:
    """Return one line of text, its baseline at y."""
    return (
        f'<text x="{x:g}" y="{y:g}" font-size="{size_px:g}" font-weight="{weight}" fill="{color}" '
        f'text-anchor="{anchor}">{escape(text)}</text>'
    )


def write_svg(svg: str, output: str | Path) -> None:
    """Write a diagram to a new SVG file.

    Raises:
        BadInput: If the file exists, or its name does not end in .svg.
    """
    path = Path(output)
    if path.suffix != ".svg":
        raise BadInput("not a diagram's name; valid ending: .svg", path)
    if path.exists():
        raise BadInput("exists already; delete it or give another name", path)
    path.write_text(svg, encoding="utf-8")
