"""lens.toml: round trip, turned images, and what is refused."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.imaging import Turn
from haptigraph.lens import Lens
from haptigraph.registration.lens_file import (
    LensFile,
    LensImage,
    Parameters,
    Quality,
    lens_file_text,
    load_lens,
)

LENS = Lens((900.5, 901.25), (642.75, 358.5), (-0.0786, -0.0193, -0.000386, -0.00008, -0.0012), 0.0625)
SD = Parameters((0.5, 0.25), (0.125, 0.5), (1e-4, 5e-4, 5e-6, 6e-6, 6e-4))
FILE = LensFile(1, LensImage(1280, 720), LENS, 'video "a\\b"', SD, Quality(0.25, 20, 0.95))


@pytest.mark.parametrize("file", [FILE, LensFile(1, LensImage(1280, 720), replace(LENS, sd_px=None))])
def test_a_written_file_reads_back(tmp_path, file):
    path = tmp_path / "lens.toml"
    path.write_text(lens_file_text(file), encoding="utf-8")
    assert load_lens(path) == file


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("rotate_deg", [0, 90, 180, 270])
def test_correcting_and_turning_commute(rotate_deg, mirror):
    turn = Turn(rotate_deg, mirror)
    size_px = turn.size_before_px((1280, 720))  # its inverse swaps the sides alike
    turned = FILE.for_images(size_px, turn, "lens.toml")
    for at_px in ((100.0, 80.0), (900.0, 650.0), (1279.0, 0.0)):
        expected = turned_point(LENS.undistorted(at_px), turn)
        assert math.dist(turned.undistorted(turned_point(at_px, turn)), expected) < 1e-4


def turned_point(at_px, turn):
    (x, y), (width, height) = at_px, (1280, 720)
    for _ in range(turn.rotate_deg // 90):
        x, y, width, height = height - 1 - y, x, height, width
    return (width - 1 - x if turn.mirror else x), y


@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("rotate_deg", [0, 90, 180, 270])
def test_a_turned_point_is_where_the_image_has_it(rotate_deg, mirror):
    image, turn = np.zeros((720, 1280), np.uint8), Turn(rotate_deg, mirror)
    image[80, 100] = 255
    x, y = turned_point((100, 80), turn)
    assert turn(image)[y, x] == 255


def test_images_of_another_size_are_refused():
    with pytest.raises(BadInput, match=r"lens\.toml: is for images of 1280 x 720 px, .* 640 x 360 px"):
        FILE.for_images((640, 360), Turn(), "lens.toml")
    with pytest.raises(BadInput, match="have 720 x 1280"):
        FILE.for_images((1280, 720), Turn(90), "lens.toml")


@pytest.mark.parametrize(
    "before, after, problem",
    [
        ("format = 1", "format = 2", "line 2: unknown format 2; this version reads format 1"),
        ("[900.500, 901.250]", "[9.0, 9.0]", "focal lengths of 9 and 9 px are implausible"),
        ("[900.500, 901.250]", "[900.0, 700.0]", "within 10% of each other"),
        ("[642.750, 358.500]", "[1500.0, 358.5]", r"principal point \(1500, 358.5\) px is outside"),
        ("-0.0786", "-0.9", "maps two points to one place"),
        ("-0.0786, ", "", "lens.distortion: expected array of length 5"),
    ],
)
def test_an_implausible_lens_is_refused(tmp_path, before, after, problem):
    path = tmp_path / "lens.toml"
    text = lens_file_text(FILE)
    assert before in text
    path.write_text(text.replace(before, after, 1), encoding="utf-8")
    with pytest.raises(BadInput, match=problem):
        load_lens(path)
