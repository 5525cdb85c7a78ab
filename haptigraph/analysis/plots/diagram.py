"""State diagram of a procedure: as in the paper, misaligned left and aligned right, or as a staircase.

Writes the SVG itself, so that the same procedure gives the same bytes.
"""

from html import escape

from haptigraph.analysis.plots.boxes import BOX_HEIGHT, BOX_WIDTH, Box, box_svg, fitting_px
from haptigraph.analysis.plots.staircase import ROW, staircase_boxes, staircase_lines, staircase_width
from haptigraph.analysis.plots.svg import FONT, text_svg
from haptigraph.inference.colors import palette
from haptigraph.inference.procedure import Procedure, State
from haptigraph.messages import TIP_NOT_VISIBLE, UNKNOWN
from haptigraph.proof.neighbours import neighbours

__all__ = ["column_of", "diagram_svg"]

WIDTH, GAP = 720, 42
COLUMNS = {"left": WIDTH * 0.25, "middle": WIDTH * 0.5, "right": WIDTH * 0.75}
TOP, LINE_HEIGHT, MAX_PASSING = 92, 17, 2
DIM, LINE = "#666666", "#7a858e"
WITHOUT_TIP = (UNKNOWN, TIP_NOT_VISIBLE)
"""States to and from which no line is drawn, because it would be one from every other state."""


def column_of(state: State) -> str:
    """Return a state's column in the paper's diagram: left if misaligned, right if aligned, else middle."""
    predicates = {predicate for _, predicate, _ in state.when}
    if "misaligned" in predicates:
        return "left"
    return "right" if "aligned" in predicates else "middle"


def diagram_svg(procedure: Procedure) -> str:
    """Return the diagram of a procedure as SVG.

    It is arranged as in the paper if few lines pass a row of boxes, else as a staircase.
    """
    boxes, pairs = _layout(procedure), neighbours(procedure)
    passing = [pair for pair in pairs if abs(boxes[pair[0]].row - boxes[pair[1]].row) > 1]
    numbers = {state.name: number for number, state in enumerate(procedure.states)}
    as_in_paper = len(passing) <= MAX_PASSING
    if as_in_paper:
        width, row, line = float(WIDTH), BOX_HEIGHT + GAP, "line"
        lines = [_arrow_svg(boxes[one], boxes[other], one, other) for one, other in pairs]
    else:
        seen = [name for name in reversed(numbers) if name not in WITHOUT_TIP]
        boxes = staircase_boxes([*seen, *(name for name in WITHOUT_TIP if name in numbers)], TOP)
        width, row, line = max(WIDTH, staircase_width(boxes)), ROW, "dot"
        lines = staircase_lines(boxes, pairs, numbers)
    height = TOP + (1 + max(box.row for box in boxes.values())) * row + (46 if as_in_paper else 68)
    paints, kinds = palette(procedure), procedure.kinds
    parts = [
        *_head_svg(procedure, width, height),
        *(_sides_svg(procedure) if as_in_paper else []),
        *lines,
        *(
            box_svg(boxes[name], numbers[name], procedure.states[numbers[name]], paints[name], kinds[name])
            for name in boxes
        ),
        *_notes_svg(boxes, width, height, line),
    ]
    return "\n".join([*parts, "</svg>", ""])


def _head_svg(procedure: Procedure, width: float, height: float) -> list[str]:
    title_px = fitting_px(procedure.title, width - 40, 18)
    return [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" width="{width:g}" '
        f'height="{height:g}" {FONT}>',
        f'<rect width="{width:g}" height="{height:g}" fill="#ffffff"/>',
        '<defs><marker id="head" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="9" markerHeight="9" '
        f'markerUnits="userSpaceOnUse" orient="auto-start-reverse"><path d="M0 0 10 5 0 10z" fill="{LINE}"/>'
        "</marker></defs>",
        text_svg(width / 2, 30, procedure.title, size_px=title_px, weight="bold"),
    ]


def _sides_svg(procedure: Procedure) -> list[str]:
    if {column_of(state) for state in procedure.states} == {"middle"}:
        return []
    return [
        text_svg(COLUMNS[side], 62, text, size_px=14, color=DIM)
        for side, text in (("left", "misaligned"), ("right", "aligned"))
    ]


def _notes_svg(boxes: dict[str, Box], width: float, height: float, line: str) -> list[str]:
    lost = " or ".join(repr(name) for name in WITHOUT_TIP if name in boxes)
    crossing, around = "one measure crosses one threshold", f"Every state may also become {lost}, and back."
    notes = ["Numbers are priorities: of the rules that fit, the lowest number wins."]
    if line == "line":
        notes.append(f"A line: {crossing}. {around}")
    else:
        notes += [f"A dot: {crossing}, between the state of its row and that of its column.", around]
    return [
        text_svg(width / 2, height - 17 - (len(notes) - 1 - at) * LINE_HEIGHT, text, size_px=11.5, color=DIM)
        for at, text in enumerate(notes)
    ]


def _layout(procedure: Procedure) -> dict[str, Box]:
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
        name: Box(COLUMNS[side], TOP + row * (BOX_HEIGHT + GAP) + BOX_HEIGHT / 2, row)
        for row, names in enumerate(rows)
        for name, side in names
    }


def _pairs(names: list[str]) -> list[list[tuple[str, str]]]:
    """Arrange states in pairs, a single one in the middle."""
    rows = [names[at : at + 2] for at in range(0, len(names), 2)]
    return [[(row[0], "middle")] if len(row) == 1 else [(row[0], "left"), (row[1], "right")] for row in rows]


def _arrow_svg(one: Box, other: Box, name: str, other_name: str) -> str:
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


def _exit_x(box: Box, other: Box) -> float:
    """Return the x at which a line to another box leaves: off the middle, towards the other."""
    share = 0.0 if box.x == other.x else 0.3 if box.x < other.x else -0.3
    return box.x + share * BOX_WIDTH


def _detour(upper: Box, lower: Box) -> str:
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
