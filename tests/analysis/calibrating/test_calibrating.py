"""From pictures of the sheet to lens.toml, and on the command line."""

import cv2
import numpy as np
import pytest
from helpers import call
from lens import SheetCamera

from haptigraph.analysis.calibrating.board import Board
from haptigraph.analysis.calibrating.calibrating import find_views
from haptigraph.errors import BadInput
from haptigraph.lens import Lens
from haptigraph.registration.lens_file import load_lens

SIZE_PX = 640, 360
LENS = Lens((450.0, 450.2), (322.0, 183.0), (-0.1, 0.02, 5e-4, -4e-4, 0.0))
BOARD = Board(24, 17)


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pictures")
    camera = SheetCamera(LENS, BOARD, np.random.default_rng(2), SIZE_PX)
    for number in range(16):
        cv2.imwrite(str(folder / f"{number:02}.png"), camera.picture())
    return folder


def test_pictures_become_a_lens(pictures, tmp_path):
    output = tmp_path / "lens.toml"
    result = call("calibrate", "camera", str(pictures), "-o", str(output))
    assert result.exit_code == 0, result.output
    assert "barrel" in result.output and "register SOURCE --lens" in result.output
    file = load_lens(output)
    assert file.lens.focal_px == pytest.approx(LENS.focal_px, rel=0.01)
    assert file.lens.sd_px < 0.5 and file.quality.coverage > 0.8
    for at_px in ((60.0, 40.0), (320.0, 180.0), (600.0, 330.0)):
        expected = LENS.undistorted(at_px)
        assert np.hypot(*np.subtract(file.lens.undistorted(at_px), expected)) < 1.5  # without alignment
    again = call("calibrate", "camera", str(pictures), "-o", str(output))
    assert again.exit_code == 2 and "exists already; --force overwrites it" in again.output


def test_the_same_position_counts_once(pictures):
    image = cv2.imread(str(pictures / "00.png"))
    views, size_px = find_views([image] * 5, BOARD, "clip")
    assert (len(views), size_px) == (1, SIZE_PX)


@pytest.mark.parametrize(
    "images, problem",
    [
        ([], "clip: has no images"),
        ([np.zeros((90, 160, 3), np.uint8)], "clip: no sheet of 24x17 squares was found in it; print one"),
        ([np.zeros((90, 160), np.uint8), np.zeros((80, 160), np.uint8)], "clip: its images differ in size"),
    ],
)
def test_a_source_without_a_sheet_is_refused(images, problem):
    with pytest.raises(BadInput, match=problem):
        find_views(images, BOARD, "clip")


def test_what_does_not_determine_the_lens_leaves_no_file(pictures, tmp_path):
    few, output = tmp_path / "few", tmp_path / "lens.toml"
    few.mkdir()
    for number in range(3):
        (few / f"{number}.png").write_bytes((pictures / f"{number:02}.png").read_bytes())
    result = call("calibrate", "camera", str(few), "-o", str(output))
    assert result.exit_code == 2 and "in 3 different positions, at least 8 are needed" in result.output
    turned = call("calibrate", "camera", str(few), "-o", str(output), "--set", "source.mirror=true")
    assert turned.exit_code == 2 and "images as the camera takes them" in turned.output
    assert not output.exists()


def test_the_sheet_is_written_by_a_command(tmp_path):
    path = tmp_path / "sheet.svg"
    result = call("calibrate", "sheet", "-o", str(path), "--squares", "10x8", "--square-mm", "12")
    assert result.exit_code == 0 and path.read_text().startswith("<?xml")
    assert "--squares 10x8" in result.output
    wrong = call("calibrate", "sheet", "-o", str(tmp_path / "s.svg"), "--squares", "10by8")
    assert wrong.exit_code == 2 and "COLUMNSxROWS" in wrong.output
