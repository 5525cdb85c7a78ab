"""The ChArUco board: a chessboard with markers in its white squares, so that a part of it suffices.

Turns a picture into the numbered corners of the board, sub-pixel (S. Garrido-Jurado et al., "Automatic
generation and detection of highly reliable fiducial markers under occlusion", Pattern Recognition 47, 2014).
"""

import re
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from msgspec import Struct

from haptigraph.errors import BadInput
from haptigraph.imaging import Floats, grey_of
from haptigraph.messages import Image

__all__ = ["CELLS", "Board", "View", "parse_board"]

CELLS = 11
"""Cells along a square; a marker has 7, so that the whole board is a bitmap of cells."""
MARKER_CELLS = 7
DICTIONARY, MARKERS = cv2.aruco.DICT_5X5_250, 250
MIN_SQUARES = 4
MIN_CORNERS = 12
WINDOW, WINDOW_PX = 0.14, (2, 10)
"""Half the window in which a corner is refined, relative to a square, and its limits."""
REFINING_STEPS, REFINING_PX = 40, 0.005


class View(Struct, frozen=True, eq=False):
    """The corners of the board in one picture."""

    numbers: Floats
    """Which corners, (n,)."""
    points_px: Floats
    """(n, 2)"""
    board_points: Floats
    """The corners on the board [squares], (n, 2); x is reversed where the picture is mirrored."""


class Board(Struct, frozen=True, dict=True):
    """A board of columns x rows squares."""

    columns: int
    rows: int

    @property
    def bitmap(self) -> Image:
        """The board, one pixel a cell: 0 is black."""
        cells = self.columns * CELLS, self.rows * CELLS
        return np.asarray(self._charuco.generateImage(cells, marginSize=0, borderBits=1), np.uint8)

    def find(self, image: Image) -> View | None:
        """Return the corners in a picture, also in a mirrored one; None if fewer than 12 were found."""
        grey = grey_of(image)
        for mirrored in (False, True):
            seen = np.ascontiguousarray(grey[:, ::-1]) if mirrored else grey
            corners, numbers, _, _ = self._detector.detectBoard(seen)
            if numbers is None or len(numbers) < MIN_CORNERS:
                continue
            numbers, points = numbers.ravel(), _refined(seen, corners)
            on_board = self._corners[numbers]
            if mirrored:
                points[:, 0] = grey.shape[1] - 1 - points[:, 0]
                on_board = on_board * (-1, 1)
            return View(numbers, points, on_board)
        return None

    @cached_property
    def _charuco(self) -> Any:
        dictionary = cv2.aruco.getPredefinedDictionary(DICTIONARY)
        return cv2.aruco.CharucoBoard((self.columns, self.rows), CELLS, MARKER_CELLS, dictionary)

    @cached_property
    def _detector(self) -> Any:
        return cv2.aruco.CharucoDetector(self._charuco)

    @cached_property
    def _corners(self) -> Floats:
        return np.asarray(self._charuco.getChessboardCorners(), np.float64)[:, :2] / CELLS


def _refined(grey: Image, corners: Any) -> Floats:
    """Return the saddle points near corners, (n, 2); the windows keep clear of the markers."""
    points = corners.reshape(-1, 2).astype(np.float32)
    distances = np.linalg.norm(points[:, None] - points, axis=2)
    np.fill_diagonal(distances, np.inf)
    half_px = int(np.clip(WINDOW * np.median(distances.min(axis=1)), *WINDOW_PX))
    stop = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, REFINING_STEPS, REFINING_PX
    refined = cv2.cornerSubPix(grey, points.reshape(-1, 1, 2).copy(), (half_px, half_px), (-1, -1), stop)
    return np.asarray(refined.reshape(-1, 2), np.float64)


def parse_board(text: str) -> Board:
    """Return the board of "COLUMNSxROWS".

    Raises:
        BadInput: If it is not that, or such a board has too many markers or too few squares.
    """
    match = re.fullmatch("([0-9]{1,3})x([0-9]{1,3})", text)
    if match is None:
        raise BadInput(f"--squares {text!r} is not COLUMNSxROWS, e.g. 17x11")
    board = Board(int(match[1]), int(match[2]))
    if min(board.columns, board.rows) < MIN_SQUARES or board.columns * board.rows > 2 * MARKERS:
        raise BadInput(
            f"--squares {text} is not possible; a sheet has at least {MIN_SQUARES} squares either way and at "
            f"most {2 * MARKERS} in all"
        )
    return board
