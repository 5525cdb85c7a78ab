"""State diagram of a procedure as in the paper: misaligned left, aligned right, numbers are priorities.

Writes the SVG itself, so that the same procedure gives the same bytes.
"""

from html import escape
from pathlib import Path
from typing import NamedTuple

from haptigraph.errors import BadInput
from haptigraph.inference.colors import Paint, palette
from haptigraph.inference.meaning import Kind
from haptigraph.inference.procedure import Procedure, State
from haptigraph.messages import TIP_NOT_VISIBLE, UNKNOWN
from haptigraph.proof.neighbours import neighbours

__all__ = ["column_of", "diagram_svg", "write_diagram"]

WIDTH, BOX_WIDTH, BOX_HEIGHT, GAP = 720, 270, 68, 42
COLUMNS = {"left": WIDTH * 0.25, "middle": WIDTH * 0.5, "right": WIDTH * 0.75}
TOP, LINE_HEIGHT, MAX_LABEL = 92, 17, 24
INK, DIM, LINE = "#222222", "#666666", "#7a858e"
WITHOUT_TIP = (UNKNOWN, TIP_NOT_VISIBLE)
"""States to and from which no line is drawn, because it would be one from every other state."""


class _Box(NamedTuple):
    """Position of a state: its centre, and its row from the top."""

    x: float
    y: float
    row: int


def write_diagram(procedure: Procedure, output: str | Path) -> None:
    """Write the diagram of a procedure to a new SVG file.

    Raises:
        BadInput: If the file exists, or its name does not end in .svg.
    """
    path = Path(output)
    if path.suffix != ".svg":
        raise BadInput("not a diagram's name; valid ending: .svg", path)
    if path.exists():
        raise BadInput("exists already; delete it or give another name", path)
    path.write_text(diagram_svg(procedure), encoding="utf-8")


def column_of(state: State) -> str:
    """Return a state's column in the paper's diagram: left if misaligned, right if aligned, else middle."""
    predicates = {predicate for _, predicate, _ in state.when}
    if "misaligned" in predicates:
        return "left"
    return "right" if "aligned" in predicates else "middle"


def diagram_svg(procedure: Procedure) -> str:
    """Return the diagram of a procedure as SVG."""
    boxes = _layout(procedure)
    rows = 1 + max(box.row for box in boxes.values())
    height = TOP + rows * (BOX_HEIGHT + GAP) + 46
    states = {state.name: (number, state) for number, state in enumerate(procedure.states)}
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height}" width="{WIDTH}" '
        f'height="{height}" font-family="DejaVu Sans, Verdana, sans-serif">',
        f'<rect width="{WIDTH}" height="{height}" fill="#ffffff"/>',
        '<defs><marker id="head" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="9" markerHeight="9" '
        f'markerUnits="userSpaceOnUse" orient="auto-start-reverse"><path d="M0 0 10 5 0 10z" fill="{LINE}"/>'
        "</marker></defs>",
        _text_svg(WIDTH / 2, 30, procedure.title, size=18, weight="bold"),
    ]
    if {column_of(state) for state in procedure.states} != {"middle"}:
        parts += [
            _text_svg(COLUMNS[side], 62, text, size=14, color=DIM)
            for side, text in (("left", "misaligned"), ("right", "aligned"))
        ]
    parts += [_arrow_svg(boxes[one], boxes[other], one, other) for one, other in neighbours(procedure)]
    paints, kinds = palette(procedure), procedure.kinds
    parts += [_box_svg(boxes[name], *states[name], paints[name], kinds[name]) for name in boxes]
    lost = " or ".join(repr(name) for name in WITHOUT_TIP if name in boxes)
    for at, text in enumerate(
        (
            "Numbers are priorities: of the rules that fit, the lowest number wins.",
            f"A line: one measure crosses one threshold. Every state may also become {lost}, and back.",
        )
    ):
        parts.append(_text_svg(WIDTH / 2, height - 34 + at * LINE_HEIGHT, text, size=11.5, color=DIM))
    return "\n".join([*parts, "</svg>", ""])


def _layout(procedure: Procedure) -> dict[str, _Box]:
    """Arrange the states downwards from low priority to high, with those without a tip last."""
    ascending = list(reversed(procedure.states))
    by_column = {
        side: [one.name for one in ascending if column_of(one) == side and one.name not in WITHOUT_TIP]
        for side in COLUMNS
    }
    priority = {state.name: number for number, state in enumerate(procedure.states)}
    left, middle, right = by_column["left"], by_column["middle"], by_column["right"]
    first = min((priority[name] for name in (*left, *right)), default=0)
    before = [name for name in middle if priority[name] > first]
    after = sorted((name for name in middle if priority[name] <= first), key=priority.__getitem__)
    rows = _pairs(before)
    for at in range(max(len(left), len(right))):
        pair = (("left", left[at : at + 1]), ("right", right[at : at + 1]))
        rows.append([(name, side) for side, names in pair for name in names])
    rows += [*_pairs(after), *_pairs([name for name in WITHOUT_TIP if name in priority])]
    return {
        name: _Box(COLUMNS[side], TOP + row * (BOX_HEIGHT + GAP) + BOX_HEIGHT / 2, row)
        for row, names in enumerate(rows)
        for name, side in names
    }


def _pairs(names: list[str]) -> list[list[tuple[str, str]]]:
    """Arrange states in pairs, a single one in the middle."""
    rows = [names[at : at + 2] for at in range(0, len(names), 2)]
    return [[(row[0], "middle")] if len(row) == 1 else [(row[0], "left"), (row[1], "right")] for row in rows]


def _box_svg(box: _Box, number: int, state: State, paint: Paint, kind: Kind) -> str:
    color, ink = paint.color, paint.ink
    dash = ' stroke-dasharray="6 4"' if kind == "unseen" else ""
    left, top = box.x - BOX_WIDTH / 2, box.y - BOX_HEIGHT / 2
    lines = _label_lines(state.name.replace("_", " "))
    text = [
        _text_svg(
            left + 50, box.y - 3 + (at - (len(lines) - 1) / 2) * LINE_HEIGHT, line, color=ink, anchor="start"
        )
        for at, line in enumerate(lines)
    ]
    feel_y = box.y + 13 + (len(lines) - 1) / 2 * LINE_HEIGHT
    return "\n".join(
        [
            f'<g><title>{escape(state.because)}</title><rect x="{left:g}" y="{top:g}" width="{BOX_WIDTH}" '
            f'height="{BOX_HEIGHT}" rx="10" fill="{color}" stroke="#555555"{dash}/>',
            f'<circle cx="{left + 26:g}" cy="{box.y:g}" r="15" fill="#ffffff" stroke="#555555"/>',
            _text_svg(left + 26, box.y + 5, str(number), weight="bold"),
            *text,
            _text_svg(left + 50, feel_y, f"{kind}, feels {state.feel}", size=11, color=ink, anchor="start"),
            "</g>",
        ]
    )


def _arrow_svg(one: _Box, other: _Box, name: str, other_name: str) -> str:
    """Connect two states; lines that pass other rows run between the columns or outside of them."""
    upper, lower = sorted((one, other), key=lambda box: (box.row, box.x))
    if upper.row == lower.row:
        path = f"M{upper.x + BOX_WIDTH / 2:g} {upper.y:g} L{lower.x - BOX_WIDTH / 2:g} {lower.y:g}"
    elif lower.row == upper.row + 1:
        start, end = _exit_x(upper, lower), _exit_x(lower, upper)
        path = f"M{start:g} {upper.y + BOX_HEIGHT / 2:g} L{end:g} {lower.y - BOX_HEIGHT / 2:g}"
    else:
        path = _detour(upper, lower)
    return (
        f'<path d="{path}" fill="none" stroke="{LINE}" stroke-width="1.5" marker-start="url(#head)" '
        f'marker-end="url(#head)"><title>{escape(name)} - {escape(other_name)}</title></path>'
    )


def _exit_x(box: _Box, other: _Box) -> float:
    """Return the x at which a line to another box leaves: off the middle, towards the other."""
    share = 0.0 if box.x == other.x else 0.3 if box.x < other.x else -0.3
    return box.x + share * BOX_WIDTH


def _detour(upper: _Box, lower: _Box) -> str:
    """Return a path past the rows between: in the middle, or beside the column of both boxes."""
    if upper.x != lower.x:
        lane = COLUMNS["middle"] + (lower.x - upper.x) * 0.08
        side = 1 if lower.x > lane else -1
        ends = lower.x - side * BOX_WIDTH / 2
        starts = upper.y + BOX_HEIGHT / 2
        if upper.x != COLUMNS["middle"]:
            side_up = 1 if upper.x < lane else -1
            return (
                f"M{upper.x + side_up * BOX_WIDTH / 2:g} {upper.y:g} Q{lane:g} {upper.y:g} {lane:g} "
                f"{upper.y + 30:g} V{lower.y - BOX_HEIGHT / 2 - GAP / 2:g} L{_exit_x(lower, upper):g} "
                f"{lower.y - BOX_HEIGHT / 2:g}"
            )
        level = lower.y - 16  # off the middle, where lines connect the two columns
        return f"M{lane:g} {starts:g} V{level - 14:g} Q{lane:g} {level:g} {ends:g} {level:g}"
    side = -1 if upper.x < COLUMNS["middle"] else 1
    edge = upper.x + side * BOX_WIDTH / 2
    out = edge + side * 34
    return f"M{edge:g} {upper.y:g} C{out:g} {upper.y:g} {out:g} {lower.y:g} {edge:g} {lower.y:g}"


def _label_lines(label: str) -> list[str]:
    """Split a long name into two lines at the space nearest to its middle."""
    spaces = [at for at, letter in enumerate(label) if letter == " "]
    if len(label) <= MAX_LABEL or not spaces:
        return [label]
    at = min(spaces, key=lambda space: abs(space - len(label) / 2))
    return [label[:at], label[at + 1 :]]


def _text_svg(
    x: float,
    y: float,
    text: str,
    *,
    size: float = 13.5,
    color: str = INK,
    weight: str = "normal",
    anchor: str = "middle",
) -> str:
    return (
        f'<text x="{x:g}" y="{y:g}" font-size="{size:g}" font-weight="{weight}" fill="{color}" '
        f'text-anchor="{anchor}">{escape(text)}</text>'
    )
