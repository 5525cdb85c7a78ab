import cv2
import numpy as np
import pytest

from haptigraph.geometry import Homography
from haptigraph.registration.background import BackgroundImage


@pytest.fixture
def picture() -> np.ndarray:
    y, x = np.mgrid[:90, :160]
    return np.dstack([x, 2 * y, 255 - x]).astype(np.uint8)


@pytest.mark.parametrize("hidden", [slice(0, 0), slice(20, 40), slice(0, 90)])
def test_a_picture_keeps_its_colours_and_exactly_what_is_known(picture, hidden):
    is_known = np.ones(picture.shape[:2], bool)
    is_known[hidden, 50:70] = False
    read = BackgroundImage.of_webp(BackgroundImage(picture, is_known).webp)
    assert (read.is_known == is_known).all()
    assert np.abs(read.image.astype(int) - picture)[is_known].mean() < 3


def test_what_is_no_picture_in_colour_is_none(picture):
    grey = cv2.imencode(".png", picture[..., 0])[1].tobytes()
    deep = cv2.imencode(".png", picture.astype(np.uint16))[1].tobytes()
    assert [BackgroundImage.of_webp(data) for data in (b"", b"RIFFxxxx", grey, deep)] == [None] * 4


def test_a_slant_is_taken_away_and_nothing_is_known_beside_the_picture(picture):
    is_known = np.ones(picture.shape[:2], bool)
    is_known[:10] = False
    moved = BackgroundImage(picture, is_known).tilt_corrected(Homography(((1, 0, 7), (0, 1, 5), (0, 0, 1))))
    assert (moved.image[40, 50] == picture[35, 43]).all()
    assert not moved.is_known[:15].any() and moved.is_known[15:].all()
