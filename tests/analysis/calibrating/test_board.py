"""Corners of the sheet in pictures, and which boards there are."""

import cv2
import numpy as np
import pytest

from haptigraph.analysis.calibrating.board import CELLS, Board, parse_board
from haptigraph.errors import BadInput

BOARD = Board(9, 7)
CELL_PX = 4


def picture(blur_px=0.8) -> np.ndarray:
    bitmap = cv2.copyMakeBorder(BOARD.bitmap, *[CELLS] * 4, cv2.BORDER_CONSTANT, value=255)
    large = cv2.resize(bitmap, None, fx=CELL_PX, fy=CELL_PX, interpolation=cv2.INTER_NEAREST)
    return cv2.GaussianBlur(large, (0, 0), blur_px)


def expected_px(view, mirrored=False) -> np.ndarray:
    at = (np.abs(view.board_points) + 1) * CELLS * CELL_PX - 0.5
    return (picture().shape[1] - 1, 0) + at * (-1, 1) if mirrored else at


@pytest.mark.parametrize("mirrored", [False, True])
def test_every_corner_is_found_to_a_fraction_of_a_pixel(mirrored):
    image = picture()[:, ::-1] if mirrored else picture()
    view = BOARD.find(image)
    assert len(view.numbers) == 8 * 6
    assert np.abs(view.points_px - expected_px(view, mirrored)).max() < 0.05
    assert (view.board_points[:, 0] < 0).all() == mirrored


def test_a_part_of_the_sheet_suffices_and_its_corners_keep_their_numbers():
    whole, part = BOARD.find(picture()), BOARD.find(picture()[:, : round(5.5 * CELLS * CELL_PX)])
    assert 12 <= len(part.numbers) < len(whole.numbers)
    assert np.isin(part.numbers, whole.numbers).all()
    assert np.abs(part.points_px - expected_px(part)).max() < 0.05


def test_what_is_no_sheet_has_no_corners():
    rng = np.random.default_rng(1)
    assert BOARD.find(rng.integers(0, 256, (200, 300), np.uint8)) is None
    assert BOARD.find(np.zeros((200, 300, 3), np.uint8)) is None
    assert Board(6, 10).find(picture()[:90, :90]) is None


def test_boards_are_read_from_text():
    assert parse_board("24x17") == Board(24, 17)
    for text in ("24", "24x", "ax7", "-3x9", "24x17x2"):
        with pytest.raises(BadInput, match=r"--squares '.*' is not COLUMNSxROWS, e\.g\. 17x11"):
            parse_board(text)
    for text in ("3x9", "30x20"):
        with pytest.raises(BadInput, match="at least 4 squares either way and at most 500 in all"):
            parse_board(text)
