"""The box of a state in diagrams: its priority, name, kind and pattern in the state's colour."""

from html import escape
from typing import NamedTuple

from haptigraph.analysis.plots.svg import text_svg
from haptigraph.inference.colors import Paint
from haptigraph.inference.meaning import Kind
from haptigraph.inference.procedure import State

__all__ = ["BOX_HEIGHT", "BOX_WIDTH", "Box", "box_svg", "fitting_px"]

BOX_WIDTH, BOX_HEIGHT = 270, 68
TEXT_LEFT, TEXT_RIGHT = 50, 12
MAX_LABEL, LINE_HEIGHT = 24, 17
EM = 0.64
"""Average width of letters in DejaVu Sans, generously, per font size."""


class Box(NamedTuple):
    """Position of a state: its centre, and its row from the top."""

    x: float
    y: float
    row: int


def box_svg(box: Box, number: int, state: State, paint: Paint, kind: Kind) -> str:
    """Return the box of a state with a priority."""
    color, ink = paint.color, paint.ink
    dash = ' stroke-dasharray="6 4"' if kind == "unseen" else ""
    left, top = box.x - BOX_WIDTH / 2, box.y - BOX_HEIGHT / 2
    text_x, room = left + TEXT_LEFT, BOX_WIDTH - TEXT_LEFT - TEXT_RIGHT
    lines = _label_lines(state.name.replace("_", " "))
    size_px = min(fitting_px(line, room, 13.5) for line in lines)
    middle = (len(lines) - 1) / 2
    text = [
        text_svg(
            text_x, box.y - 3 + (at - middle) * LINE_HEIGHT, line, size_px=size_px, color=ink, anchor="start"
        )
        for at, line in enumerate(lines)
    ]
    feels = f"{kind}, feels {state.feel}"
    feels_px = fitting_px(feels, room, 11)
    return "\n".join(
        [
            f'<g><title>{escape(state.because)}</title><rect x="{left:g}" y="{top:g}" width="{BOX_WIDTH}" '
            f'height="{BOX_HEIGHT}" rx="10" fill="{color}" stroke="#555555"{dash}/>',
            f'<circle cx="{left + 26:g}" cy="{box.y:g}" r="15" fill="#ffffff" stroke="#555555"/>',
            text_svg(left + 26, box.y + 5, str(number), weight="bold"),
            *text,
            text_svg(
                text_x, box.y + 13 + middle * LINE_HEIGHT, feels, size_px=feels_px, color=ink, anchor="start"
            ),
            "</g>",
        ]
    )


def fitting_px(text: str, room_px: float, largest_px: float) -> float:
    """Return the largest font size up to a limit at which a text fits into a width [px]."""
    return min(largest_px, round(room_px / (EM * max(len(text), 1)), 1))


def _label_lines(label: str) -> list[str]:
    """Split a long name into two lines at the space nearest to its middle."""
    spaces = [at for at, letter in enumerate(label) if letter == " "]
    if len(label) <= MAX_LABEL or not spaces:
        return [label]
    at = min(spaces, key=lambda space: abs(space - len(label) / 2))
    return [label[:at], label[at + 1 :]]
