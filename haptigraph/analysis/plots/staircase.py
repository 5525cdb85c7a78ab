"""States one below the other, each with a line of its own that comes down like a stair; dots join neighbours.

However many neighbours there are, no two lines share a stretch, and none passes a box.
"""

from collections.abc import Mapping, Sequence
from html import escape

from haptigraph.analysis.plots.boxes import BOX_HEIGHT, BOX_WIDTH, Box
from haptigraph.analysis.plots.svg import text_svg

__all__ = ["ROW", "staircase_boxes", "staircase_lines", "staircase_width"]

LEFT, ROW, FIRST_LANE, LANE = 30, BOX_HEIGHT + 14, 44, 34
LINE, DOT, DIM = "#7a858e", "#222222", "#666666"


def staircase_boxes(names: Sequence[str], top: float) -> dict[str, Box]:
    """Return where the boxes of states are, from the top down."""
    x = LEFT + BOX_WIDTH / 2
    return {name: Box(x, top + row * ROW + BOX_HEIGHT / 2, row) for row, name in enumerate(names)}


def staircase_width(boxes: Mapping[str, Box]) -> float:
    """Return how wide boxes and lines are together."""
    return _lane_x(len(boxes) - 1) + LEFT


def staircase_lines(
    boxes: Mapping[str, Box], pairs: Sequence[tuple[str, str]], numbers: Mapping[str, int]
) -> list[str]:
    """Return the lines and dots that join neighbours.

    Args:
        boxes: Where the states are.
        pairs: Names of neighbours.
        numbers: The states' priorities.
    """
    ordered = [sorted(pair, key=lambda name: boxes[name].row) for pair in pairs]
    parts = []
    for name, box in boxes.items():
        below = [boxes[lower].y for upper, lower in ordered if upper == name]
        lanes = [_lane_x(boxes[upper].row) for upper, lower in ordered if lower == name]
        if not below and not lanes:
            continue
        end = _lane_x(box.row) if below else max(lanes)
        down = f" V{max(below):g}" if below else ""
        parts.append(
            f'<path d="M{LEFT + BOX_WIDTH} {box.y:g} H{end:g}{down}" fill="none" stroke="{LINE}" '
            f'stroke-width="1.5"><title>{escape(name)}</title></path>'
        )
        if below:
            parts.append(text_svg(end, box.y - 6, str(numbers[name]), size_px=11.5, color=DIM))
    for upper, lower in ordered:
        parts.append(
            f'<circle cx="{_lane_x(boxes[upper].row):g}" cy="{boxes[lower].y:g}" r="5" fill="{DOT}">'
            f"<title>{escape(upper)} - {escape(lower)}</title></circle>"
        )
    return parts


def _lane_x(row: int) -> float:
    return LEFT + BOX_WIDTH + FIRST_LANE + row * LANE
