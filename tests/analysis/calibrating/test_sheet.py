"""The printed sheet: at true size, readable by the calibration, in every format."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from haptigraph.analysis.calibrating.board import Board
from haptigraph.analysis.calibrating.sheet import sheet_bytes
from haptigraph.errors import BadInput

BOARD = Board(12, 8)
MM_PER_PX = 25.4 / 600


def test_the_picture_shows_the_board_at_true_size():
    image = cv2.imdecode(np.frombuffer(sheet_bytes(BOARD, 15, "a4", Path("sheet.png")), np.uint8), 0)
    assert image.shape[0] * MM_PER_PX == pytest.approx(210, abs=0.1)
    assert image.shape[1] * MM_PER_PX == pytest.approx(297, abs=0.1)
    small = cv2.resize(image, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    view = BOARD.find(small)
    assert len(view.numbers) == 11 * 7
    scale = np.linalg.lstsq(
        np.pad(view.board_points, ((0, 0), (0, 1)), constant_values=1), view.points_px, rcond=None
    )[0]
    assert scale[:2] * MM_PER_PX * 4 == pytest.approx(np.eye(2) * 15, abs=0.02)


@pytest.mark.parametrize("ending, size", [("pdf", "/MediaBox [ 0 0 841.88976"), ("svg", 'width="841.88976')])
def test_vector_formats_have_the_size_of_the_paper_and_are_reproducible(ending, size):
    data = sheet_bytes(BOARD, 15, "a4", Path(f"sheet.{ending}"))
    assert size.encode() in data
    assert data == sheet_bytes(BOARD, 15, "a4", Path(f"sheet.{ending}"))


def test_rulers_and_the_command_are_written_on_it():
    svg = sheet_bytes(BOARD, 15, "a4", Path("s.svg")).decode()
    for text in ("180 mm: measure it", "120 mm: measure it", "squares 12x8", "print at 100 %"):
        assert text in svg


def test_what_cannot_be_printed_is_refused():
    with pytest.raises(BadInput, match=r"360 x 240 mm, but letter has room for 243.4 x 179.9"):
        sheet_bytes(BOARD, 30, "letter", Path("s.pdf"))
    with pytest.raises(BadInput, match=r"s\.doc: a sheet is written as \.pdf, \.svg, \.png"):
        sheet_bytes(BOARD, 15, "a4", Path("s.doc"))
