"""Draw the ChArUco sheet at true size, with two rulers that show whether it was printed so."""

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from haptigraph.analysis.calibrating.board import CELLS, Board
from haptigraph.errors import BadInput
from haptigraph.figures import Figure, LineCollection, PolyCollection, rc_context
from haptigraph.geometry import Vec
from haptigraph.imaging import Mask

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["PAPERS_MM", "sheet_bytes"]

PAPERS_MM = {"a4": (297.0, 210.0), "a3": (420.0, 297.0), "letter": (279.4, 215.9)}
"""(width, height), landscape."""
FORMATS = ("pdf", "svg", "png")
MARGIN_MM = 8.0  # most printers leave 5 mm free
RULER_MM = 20.0  # room for a ruler and its text
TICK_MM = 2.0
PNG_DPI = 600
MM_PER_INCH = 25.4


def sheet_bytes(board: Board, square_mm: float, paper: str, file: Path) -> bytes:
    """Return the sheet as the file's ending says: PDF, SVG or PNG.

    Args:
        board: The board.
        square_mm: Side of a square.
        paper: Name of the paper.
        file: Name of the file that will have it.

    Raises:
        BadInput: If the board does not fit on the paper, or the file has another ending.
    """
    ending = file.suffix.lower().removeprefix(".")
    if ending not in FORMATS:
        raise BadInput(f"a sheet is written as {', '.join(f'.{each}' for each in FORMATS)}", file)
    width, height = PAPERS_MM[paper]
    across, down = board.columns * square_mm, board.rows * square_mm
    free = width - 2 * MARGIN_MM - RULER_MM, height - 2 * MARGIN_MM - RULER_MM
    if across > free[0] or down > free[1]:
        raise BadInput(
            f"{board.columns} x {board.rows} squares of {square_mm:g} mm are {across:g} x {down:g} mm, but "
            f"{paper} has room for {free[0]:g} x {free[1]:g} mm; use smaller or fewer squares"
        )
    figure = Figure(figsize=(width / MM_PER_INCH, height / MM_PER_INCH))
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(0, height))
    axes.set_axis_off()
    left, bottom = (width + RULER_MM - across) / 2, (height + RULER_MM - down) / 2
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    boxes = _boxes(board.bitmap[::-1] == 0)
    black = [(left, bottom) + square_mm / CELLS * (box[:2] + corners * box[2:]) for box in boxes]
    axes.add_collection(PolyCollection(black, facecolors="black", edgecolors="none", antialiased=False))
    _ruler(axes, (left, bottom - TICK_MM * 3), across, is_level=True)
    _ruler(axes, (left - TICK_MM * 3, bottom), down, is_level=False)
    command = f"haptigraph calibrate camera SOURCE --squares {board.columns}x{board.rows}"
    how = f"squares of {square_mm:g} mm; print at 100 % on matt paper, glue to a flat plate"
    axes.text(left, MARGIN_MM, f"{command}    {how}", fontsize=8)
    buffer = BytesIO()
    metadata: dict[str, Any] = {"pdf": {"CreationDate": None}, "svg": {"Date": None}}.get(ending, {})
    with rc_context({"svg.hashsalt": "haptigraph"}):
        figure.savefig(buffer, format=ending, dpi=PNG_DPI, metadata=metadata)
    return buffer.getvalue()


def _boxes(is_black: Mask) -> NDArray[np.int_]:
    """Return rectangles that cover the black cells: left, bottom, width, height, (n, 4)."""
    begun: dict[tuple[int, int], int] = {}
    found: list[tuple[int, int, int, int]] = []
    for number, row in enumerate([*is_black, np.zeros(is_black.shape[1], np.bool_)]):
        edges = np.flatnonzero(np.diff(np.pad(row, 1).astype(int))).tolist()
        runs = set(zip(edges[::2], edges[1::2], strict=True))
        for start, end in begun.keys() - runs:
            first = begun.pop((start, end))
            found.append((start, first, end - start, number - first))
        for run in runs:
            begun.setdefault(run, number)
    return np.array(sorted(found))


def _ruler(axes: "Axes", start_mm: Vec, room_mm: float, *, is_level: bool) -> None:
    """Draw a ruler with a tick every 10 mm."""
    ticks = np.arange(0, room_mm + 1e-6, 10.0)
    along, aside = ((1, 0), (0, 1)) if is_level else ((0, 1), (1, 0))
    ends = np.array(start_mm) + np.outer(ticks, along)
    lines = [(ends[0], ends[-1]), *((end, end - TICK_MM * np.array(aside)) for end in ends)]
    axes.add_collection(LineCollection(lines, colors="black", linewidths=0.5))
    x, y = ends[-1] - 2.5 * TICK_MM * np.array(aside)
    turn = 0 if is_level else 90
    axes.text(
        x,
        y,
        f"{ticks[-1]:g} mm: measure it",
        fontsize=8,
        ha="right",
        va=("center" if is_level else "top"),
        rotation=turn,
    )
