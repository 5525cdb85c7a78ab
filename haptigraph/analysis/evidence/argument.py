"""A safety case as a diagram in Goal Structuring Notation: SVG, drawn by hand like the state diagram.

Goals are rectangles, the strategy a parallelogram, contexts rounded rectangles, solutions circles; a diamond
marks a goal that is not developed. Each hazard has rows of its own: the diagram grows downwards.
"""

import textwrap
from collections.abc import Mapping
from html import escape
from typing import Any

from haptigraph.analysis.evidence.case import Claim, Evidence, SafetyCase
from haptigraph.analysis.evidence.tables import status_text
from haptigraph.analysis.plots.svg import FONT, text_svg

__all__ = ["PAPER", "argument_svg"]

PAPER = {
    "ground": "#ffffff", "ink": "#1c2126", "quiet": "#5a6670", "line": "#6b7780", "goal": "#f4f7f9",
    "bad": "#b3261e", "bad-ground": "#fdecea",
}  # fmt: skip
"""Colours of the diagram on white paper, by role."""
WIDTH, TRUNK_X = 1180, 30
HAZARD = (70, 235)  # left, width of the column
CLAIM = (355, 365)
CIRCLE_X, RADIUS = 785, 30
NOTE_X, NOTE_CHARS = 830, 54
SIZE, LINE, PAD = 12.5, 16, 10
CHAR = 0.62  # widest average of letters, per font size
MIN_ROW = 2 * RADIUS + 12
DIAMOND = 9


def argument_svg(case: SafetyCase, colors: Mapping[str, str] = PAPER) -> str:
    """Return the argument of a safety case as SVG.

    Args:
        case: The safety case.
        colors: By role as in `PAPER`.
    """
    drawing = _Drawing(colors)
    y = drawing.head(case)
    numbers = iter(range(1, 1 + sum(1 for _ in case.rows())))
    for place, hazard in enumerate(case.hazards, 1):
        top, joints = y, []
        for part, claim in enumerate(hazard.claims, 1):
            names = [f"Sn{next(numbers)}" for _ in claim.evidence]
            joint, y = drawing.claim(f"G{place}.{part}", claim, names, y)
            joints.append(joint)
        y = max(y, drawing.hazard(f"G{place}", hazard.hazard, hazard.holds, top, joints)) + 18
    return drawing.svg(y + 10, case.title)


class _Drawing:
    """The parts of the diagram so far; lines are drawn behind shapes."""

    def __init__(self, colors: Mapping[str, str]) -> None:
        self._colors = colors
        self._lines: list[str] = []
        self._shapes: list[str] = []
        self._trunk = self._last_branch = 0.0

    def head(self, case: SafetyCase) -> float:
        """Draw the top goal, its contexts and the strategy; return where the hazards begin."""
        goal = f"G0  Each hazard of haptic guidance under {case.title} is controlled"
        bottom = self._box(70, 20, 430, goal, "goal" if case.holds else "bad")
        made = case.origin
        software = f"commit {made.commit[:12]}" if made.commit else f"sha256 {made.software_sha256[:12]}"
        context = (
            f"C1  {case.file}, sha256 {made.procedure_sha256[:12]}; haptigraph {made.version}, {software}; "
            f"{made.made_utc}"
        )
        self._box(700, 20, 430, context, "context", corner=16)
        self._arrow(500, 44, 700, 44, filled=False)
        note = "C2  Research software, not a medical device. No compliance with a standard is claimed."
        self._box(700, 98, 430, note, "context", corner=16)
        self._lines.append(self._path("M500 54 H600 V124 H700", arrow=True, filled=False))
        top = max(bottom, 100) + 32
        strategy = "S1  Argue over each hazard; for each, over what is claimed, proved and measured"
        self._arrow(285, bottom, 285, top)
        end = self._box(90, top, 390, strategy, "goal", slant=18)
        self._trunk = (top + end) / 2
        self._lines.append(self._path(f"M99 {self._trunk:g} H{TRUNK_X}"))
        self._last_branch = self._trunk
        return max(end, 160) + 30

    def claim(self, name: str, claim: Claim, solutions: list[str], y: float) -> tuple[float, float]:
        """Draw a claim with its solutions; return the height at which it is joined, and the next free one."""
        left, width = CLAIM
        lines = self._wrapped(f"{name}  {claim.statement}", width)
        height = len(lines) * LINE + 2 * PAD
        rows = [max(MIN_ROW, len(_note(claim, each)) * LINE + 10) for each in claim.evidence]
        middle = y + max(height, sum(rows)) / 2
        self._box(left, middle - height / 2, width, lines, "goal" if claim.holds else "bad")
        at = middle - sum(rows) / 2
        for row, each, solution in zip(rows, claim.evidence, solutions, strict=True):
            self._solution(solution, claim, each, middle, at + row / 2)
            at += row
        if any(each.status == "missing" for each in claim.evidence):
            self._diamond(left + width / 2, middle + height / 2)
        return middle, y + max(height + 2 * DIAMOND, sum(rows)) + 8

    def hazard(self, name: str, title: str, holds: bool, top: float, joints: list[float]) -> float:
        """Draw a hazard left of its claims; return the height below it."""
        left, width = HAZARD
        lines = self._wrapped(f"{name}  Controlled: {title[0].lower()}{title[1:]}", width)
        height = len(lines) * LINE + 2 * PAD
        middle = joints[0] if joints else top + height / 2
        start = max(middle - height / 2, top)
        bottom = self._box(left, start, width, lines, "goal" if holds else "bad")
        middle = (start + bottom) / 2
        self._lines.append(self._path(f"M{TRUNK_X} {self._last_branch:g} V{middle:g}"))
        self._last_branch = middle
        self._arrow(TRUNK_X, middle, left, middle)
        for joint in joints:
            self._elbow(left + width, middle, CLAIM[0], joint)
        if not joints:
            self._diamond(left + width / 2, bottom)
        return bottom + 2 * DIAMOND

    def _solution(self, name: str, claim: Claim, evidence: Evidence, from_y: float, y: float) -> None:
        lacks, lines = claim.lacks(evidence), _note(claim, evidence)
        color = self._colors["bad" if lacks else "ink"]
        if evidence.status != "missing":
            ground = self._colors["bad-ground" if lacks else "goal"]
            dash = "" if evidence.status in ("holds", "fails") else ' stroke-dasharray="5 4"'
            self._shapes.append(
                f'<circle cx="{CIRCLE_X}" cy="{y:g}" r="{RADIUS}" fill="{ground}" stroke="{color}" '
                f'stroke-width="{2.4 if lacks else 1.3}"{dash}/>'
            )
            self._text(CIRCLE_X, y - 2, name, color, weight="bold", anchor="middle")
            self._text(CIRCLE_X, y + 12, evidence.source, color, size_px=10.5, anchor="middle")
            self._elbow(CLAIM[0] + CLAIM[1], from_y, CIRCLE_X - RADIUS, y)
        first = y - (len(lines) - 1) * LINE / 2 + 4
        for at, line in enumerate(lines):
            weight = "bold" if at == 0 and lacks else "normal"
            self._text(NOTE_X, first + at * LINE, line, color, size_px=11.5, weight=weight)

    def _wrapped(self, text: str, width: float) -> list[str]:
        return textwrap.wrap(text, int((width - 2 * PAD) / (SIZE * CHAR)), break_long_words=True)

    def _box(
        self,
        left: float,
        top: float,
        width: float,
        text: str | list[str],
        role: str,
        *,
        corner: float = 0,
        slant: float = 0,
    ) -> float:
        """Draw a box with text; return where it ends."""
        lines = text if isinstance(text, list) else self._wrapped(text, width - 2 * max(slant, corner / 2))
        height = len(lines) * LINE + 2 * PAD
        is_bad = role == "bad"
        ground = self._colors["bad-ground" if is_bad else "ground" if role == "context" else "goal"]
        stroke = self._colors["bad" if is_bad else "line"]
        style = f'fill="{ground}" stroke="{stroke}" stroke-width="{2.2 if is_bad else 1.2}"'
        if slant:
            right, bottom = left + width, top + height
            points = (
                f"{left + slant:g},{top:g} {right:g},{top:g} {right - slant:g},{bottom:g} {left:g},{bottom:g}"
            )
            self._shapes.append(f'<polygon points="{points}" {style}/>')
        else:
            self._shapes.append(
                f'<rect x="{left:g}" y="{top:g}" width="{width:g}" height="{height:g}" rx="{corner:g}" '
                f"{style}/>"
            )
        for at, line in enumerate(lines):
            x = left + PAD + max(slant, corner / 2)
            self._text(x, top + PAD + 12 + at * LINE, line, self._colors["ink"])
        return top + height

    def _diamond(self, x: float, y: float) -> None:
        d = DIAMOND
        self._shapes.append(
            f'<path d="M{x:g} {y:g} l{d} {d} l-{d} {d} l-{d} -{d} z" fill="{self._colors["ground"]}" '
            f'stroke="{self._colors["bad"]}" stroke-width="2"><title>not developed</title></path>'
        )

    def _elbow(self, x: float, y: float, to_x: float, to_y: float) -> None:
        """Draw an arrow that turns halfway."""
        middle = (x + to_x) / 2
        self._lines.append(self._path(f"M{x:g} {y:g} H{middle:g} V{to_y:g} H{to_x:g}", arrow=True))

    def _arrow(self, x: float, y: float, to_x: float, to_y: float, *, filled: bool = True) -> None:
        self._lines.append(self._path(f"M{x:g} {y:g} L{to_x:g} {to_y:g}", arrow=True, filled=filled))

    def _path(self, path: str, *, arrow: bool = False, filled: bool = True) -> str:
        head = f' marker-end="url(#{"supported" if filled else "context"})"' if arrow else ""
        return f'<path d="{path}" fill="none" stroke="{self._colors["line"]}" stroke-width="1.2"{head}/>'

    def _text(self, x: float, y: float, text: str, color: str, **style: Any) -> None:
        """Draw one line of text; `style` as in `text_svg`."""
        style = {"size_px": SIZE, "anchor": "start", **style}
        self._shapes.append(text_svg(x, y, text, color=color, **style))

    def svg(self, height: float, title: str) -> str:
        """Return the whole diagram."""
        line, ground = self._colors["line"], self._colors["ground"]
        marker = (
            '<marker id="{id}" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="9" markerHeight="9" '
            'markerUnits="userSpaceOnUse" orient="auto"><path d="M0 0 10 5 0 10z" fill="{fill}" '
            'stroke="{stroke}"/></marker>'
        )
        heads = marker.format(id="supported", fill=line, stroke=line)
        heads += marker.format(id="context", fill=ground, stroke=line)
        return "\n".join(
            [
                f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {height:g}" width="{WIDTH}" '
                f'height="{height:g}" {FONT} role="img">',
                f"<title>The argument about {escape(title)}, in Goal Structuring Notation</title>",
                f"<defs>{heads}</defs>",
                f'<rect width="{WIDTH}" height="{height:g}" fill="{ground}"/>',
                *self._lines,
                *self._shapes,
                "</svg>",
                "",
            ]
        )


def _note(claim: Claim, evidence: Evidence) -> list[str]:
    """Return the lines beside a solution: its status unless it holds, and its figure."""
    figure = textwrap.wrap(evidence.figure, NOTE_CHARS, break_long_words=True)
    return figure if evidence.holds else [status_text(claim, evidence), *figure]
