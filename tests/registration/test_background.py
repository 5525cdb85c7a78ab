import cv2
import numpy as np
import pytest

from haptigraph.projection import Homography
from haptigraph.registration.background import BackgroundImage


@pytest.fixture
def image() -> np.ndarray:
    y, x = np.mgrid[:90, :160]
    return np.dstack([x, 2 * y, 255 - x]).astype(np.uint8)


@pytest.mark.parametrize("occluded", [slice(0, 0), slice(20, 40), slice(0, 90)])
def test_webp_preserves_colours_and_the_exact_mask(image, occluded):
    is_known = np.ones(image.shape[:2], bool)
    is_known[occluded, 50:70] = False
    decoded = BackgroundImage.of_webp(BackgroundImage(image, is_known).webp)
    assert (decoded.is_known == is_known).all()
    assert np.abs(decoded.image.astype(int) - image)[is_known].mean() < 3


def test_bytes_that_are_no_8_bit_colour_image_decode_to_none(image):
    grey = cv2.imencode(".png", image[..., 0])[1].tobytes()
    deep = cv2.imencode(".png", image.astype(np.uint16))[1].tobytes()
    assert [BackgroundImage.of_webp(data) for data in (b"", b"RIFFxxxx", grey, deep)] == [None] * 4


def test_tilt_correction_leaves_pixels_from_outside_the_image_unknown(image):
    is_known = np.ones(image.shape[:2], bool)
    is_known[:10] = False
    moved = BackgroundImage(image, is_known).tilt_corrected(Homography(((1, 0, 7), (0, 1, 5), (0, 0, 1))))
    assert (moved.image[40, 50] == image[35, 43]).all()
    assert not moved.is_known[:15].any() and moved.is_known[15:].all()
