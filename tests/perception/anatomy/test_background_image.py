import math

import cv2
import numpy as np
import pytest
from drawn_strip import draw_rim
from msgspec.structs import replace

from haptigraph.perception.anatomy.background_image import find_background_image
from haptigraph.perception.anatomy.moving_shaft import median_image
from haptigraph.perception.needle.rectify import EyeGeometry, Line
from haptigraph.registration.tilt import CameraTilt

TURNS_DEG = -14, -10, -6, -2, 2, 6, 10, 14


@pytest.fixture
def background(registration) -> np.ndarray:
    """An eye with a pattern on a dark table."""
    eye = EyeGeometry(registration)
    image = np.full((eye.height_px, eye.width_px, 3), 50, np.uint8)
    center_px = tuple(round(value) for value in eye.center_px)
    cv2.circle(image, center_px, round(eye.outer_px), (150, 160, 170), -1)
    for radius_px in range(20, 90, 12):
        cv2.circle(image, center_px, radius_px, (140, 150, 165), 2, cv2.LINE_AA)
    return cv2.GaussianBlur(draw_rim(image, eye), (0, 0), 0.7)


def with_needle(eye: EyeGeometry, image: np.ndarray, turn_deg: float, depth_px: float = 110.0) -> np.ndarray:
    line = Line(eye.inwards_rad + math.radians(turn_deg), 0.0)
    ends = (line.at_px(eye.trocar_px, along_px) for along_px in (-90.0, depth_px))
    points = [tuple(round(16 * value) for value in end) for end in ends]
    return cv2.line(image.copy(), *points, (40, 40, 40), 5, cv2.LINE_AA, shift=4)


def noisy(images: list[np.ndarray]) -> list[np.ndarray]:
    grain = np.random.default_rng(0)
    return [np.clip(image + grain.normal(0, 1, image.shape), 0, 255).astype(np.uint8) for image in images]


@pytest.mark.parametrize("is_grey", [False, True])
def test_a_needle_that_turns_reveals_the_whole_background(registration, background, is_grey):
    eye = EyeGeometry(registration)
    images = noisy([with_needle(eye, background, turn_deg) for turn_deg in TURNS_DEG])
    if is_grey:
        images = [cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in images]
        background = np.repeat(cv2.cvtColor(background, cv2.COLOR_BGR2GRAY)[..., None], 3, axis=2)
    found = find_background_image(images, median_image(images), registration)
    assert np.abs(found.image.astype(int) - background)[found.is_known].max() <= 5
    x, y = eye.center_px
    assert found.is_known[round(y) - 30 : round(y) + 60, round(x) - 60 : round(x) + 60].all()
    x, y = (round(value) for value in eye.trocar_px)
    assert not found.is_known[y, x]  # the shaft always occludes the trocar


def test_a_region_that_is_always_occluded_stays_unknown(registration, background):
    eye = EyeGeometry(registration)
    images = noisy([with_needle(eye, background, 3.0, depth_px) for depth_px in (60, 80, 100, 100, 80, 60)])
    found = find_background_image(images, median_image(images), registration)
    line = Line(eye.inwards_rad + math.radians(3), 0.0)
    occluded, visible = (
        tuple(round(value) for value in line.at_px(eye.trocar_px, along_px)) for along_px in (40.0, 130.0)
    )
    assert not found.is_known[occluded[::-1]] and found.is_known[visible[::-1]]


def test_without_needle_detections_there_is_no_background_image(registration, background):
    eye = EyeGeometry(registration)
    for images in ([background], noisy([background] * 8), [with_needle(eye, background, 5.0)]):
        assert find_background_image(images, median_image(images), registration) is None


def test_with_a_tilted_camera_the_background_image_is_as_stored(registration, background):
    eye = EyeGeometry(registration)
    middle_px = (eye.width_px - 1) / 2, (eye.height_px - 1) / 2
    tilt = CameraTilt(middle_px, (math.radians(8), 0.0), 900.0, middle_px)
    homography, size = tilt.image_from_frontal.matrix, background.shape[1::-1]
    images = [
        cv2.warpPerspective(with_needle(eye, background, turn_deg), homography, size)
        for turn_deg in TURNS_DEG
    ]
    image = replace(registration.image, frontal_from_image=tilt.frontal_from_image)
    found = find_background_image(images, median_image(images), replace(registration, image=image))
    as_stored = cv2.warpPerspective(background, homography, size)
    inside = np.s_[80:180, 100:220]
    assert found.is_known[inside].mean() > 0.95
    assert np.abs(found.image.astype(int) - as_stored)[inside][found.is_known[inside]].max() <= 5
