"""The lens model: against OpenCV's, its inverse, and images through it."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.imaging import tilt_corrected, tilt_restored
from haptigraph.lens import Lens
from haptigraph.projection import Homography, ImageGeometry, LensMap, image_map

WIDTH, HEIGHT = 320, 180
TILT = Homography(((1.02, 0.01, 3.0), (-0.02, 0.99, -2.0), (5e-5, -8e-5, 1.0)))
small = st.floats(-1e-3, 1e-3)
lenses = st.builds(
    lambda focal, aspect, x, y, k1, k2, p1, p2: Lens((focal * aspect, focal), (x, y), (k1, k2, p1, p2, 0.0)),
    st.floats(150, 2000),
    st.floats(0.98, 1.02),
    st.floats(140, 180),
    st.floats(75, 105),
    st.floats(-0.15, 0.15),
    st.floats(-0.02, 0.02),
    small,
    small,
).filter(lambda lens: lens.is_invertible(WIDTH, HEIGHT))
points = st.tuples(st.floats(0, WIDTH - 1), st.floats(0, HEIGHT - 1))


@given(lenses, points)
def test_undistorting_and_distorting_cancel(lens, at_px):
    assert math.dist(lens.distorted(lens.undistorted(at_px)), at_px) < 1e-4


@given(lenses, points, st.sampled_from([None, TILT]))
def test_a_map_and_its_inverse_cancel(lens, at_px, homography):
    to_frontal = image_map(lens, homography)
    assert math.dist(to_frontal.inverse(to_frontal(at_px)), at_px) < 1e-3


@given(lenses, points)
def test_points_are_distorted_as_by_opencv(lens, ideal_px):
    focal = lens.ideal_focal_px
    ray = np.array([[*((np.array(ideal_px) - lens.principal_px) / focal), 1.0]])
    (across, down), (x, y) = lens.focal_px, lens.principal_px
    camera = np.array([[across, 0, x], [0, down, y], [0, 0, 1]])
    expected = cv2.projectPoints(ray, np.zeros(3), np.zeros(3), camera, np.array(lens.distortion))[0]
    assert lens.distorted(ideal_px) == pytest.approx(expected.ravel(), abs=1e-6)


def test_a_lens_that_folds_the_image_is_not_invertible():
    assert not Lens((200.0, 200.0), (160.0, 90.0), (-0.6, 0.0, 0.0, 0.0, 0.0)).is_invertible(WIDTH, HEIGHT)
    assert Lens((200.0, 200.0), (160.0, 90.0), (-0.15, 0.0, 0.0, 0.0, 0.0)).is_invertible(WIDTH, HEIGHT)


LENS = Lens((210.0, 211.0), (155.0, 93.0), (-0.12, 0.01, 1e-3, -5e-4, 0.0))


@pytest.mark.parametrize("to_frontal", [LensMap(LENS), LensMap(LENS, TILT)])
def test_images_follow_their_points(to_frontal):
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    spots = [(60.0, 40.0), (160.0, 90.0), (250.0, 120.0), (100.0, 150.0)]

    def drawn(at: list) -> np.ndarray:
        light = sum(np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / 2 / 3**2) for cx, cy in at)
        return np.clip(250 * light, 0, 255).astype(np.uint8)

    seen, frontal = drawn(spots), drawn([to_frontal(spot) for spot in spots])
    for image, of_image in (
        (tilt_corrected(seen, to_frontal), to_frontal),
        (tilt_restored(frontal, to_frontal), None),
    ):
        for spot in spots:
            px, py = of_image(spot) if of_image else spot
            near = np.s_[round(py) - 8 : round(py) + 9, round(px) - 8 : round(px) + 9]
            weight = image[near].astype(float)
            center = (x[near] * weight).sum() / weight.sum(), (y[near] * weight).sum() / weight.sum()
            assert math.dist(center, (px, py)) < 0.25


def test_pixels_and_millimetres_go_through_the_lens():
    image = ImageGeometry((160.0, 90.0), 0.1, mirrored=True, frontal_from_image=LensMap(LENS, TILT))
    for at_mm in ((0.0, 0.0), (7.0, -6.0), (-8.0, 3.0)):
        assert image.to_mm(image.to_px(at_mm)) == pytest.approx(at_mm, abs=1e-5)
    without = ImageGeometry((160.0, 90.0), 0.1, mirrored=True, frontal_from_image=TILT)
    assert math.dist(image.to_px((8.0, 6.0)), without.to_px((8.0, 6.0))) > 2
