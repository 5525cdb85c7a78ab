"""The tilt's homographies against a pinhole camera in space."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.registration.tilt import CameraTilt

MIDDLE = (639.5, 359.5)
part_rad = st.floats(-0.3, 0.3)
points_px = st.tuples(st.floats(-250, 250), st.floats(-250, 250))
tilts = st.builds(
    lambda x, y, right, down, focal: CameraTilt((x, y), (right, down), focal, MIDDLE),
    st.floats(500, 800),
    st.floats(300, 450),
    part_rad,
    part_rad,
    st.floats(800, 1e5),
)


def projected(tilt: CameraTilt, offset: np.ndarray, height: float = 0.0) -> np.ndarray:
    """Project a point of the plane, or one at a height in front of it [px of the plane], into the image."""
    angle = math.hypot(*tilt.tilt_rad)
    rotation = np.eye(3)
    if angle:
        # the axis; z points away from the camera
        kx, ky = -tilt.tilt_rad[1] / angle, tilt.tilt_rad[0] / angle
        cross = np.array([[0, 0, ky], [0, 0, -kx], [-ky, kx, 0]])
        rotation += math.sin(-angle) * cross + (1 - math.cos(angle)) * cross @ cross
    start = np.array([*(np.array(tilt.about_px) - MIDDLE), tilt.focal_px])
    x, y, z = start + rotation @ np.array([*offset, -height])
    return np.array(MIDDLE) + tilt.focal_px * np.array([x, y]) / z


@given(tilts, points_px)
def test_the_homography_equals_the_projection_of_a_pinhole_camera(tilt, offset):
    frontal = (tilt.about_px[0] + offset[0], tilt.about_px[1] + offset[1])
    image = tilt.image_from_frontal(frontal)
    assert image == pytest.approx(tuple(projected(tilt, np.array(offset))), abs=1e-6)
    assert tilt.frontal_from_image(image) == pytest.approx(frontal, abs=1e-6)


@given(tilts, points_px, st.floats(0.0, 60.0))
def test_points_in_front_of_the_plane_are_magnified_about_the_foot(tilt, offset, height):
    # In the frontal view: by distance / (distance - height).
    frontal = tilt.frontal_from_image(tuple(projected(tilt, np.array(offset), height)))
    foot = np.array(tilt.foot_px)
    base = np.array(tilt.about_px) + offset
    angle = math.hypot(*tilt.tilt_rad)
    about = np.array(tilt.about_px) - MIDDLE
    direction = np.array(tilt.tilt_rad) / angle if angle else np.zeros(2)
    distance = tilt.focal_px * math.cos(angle) - float(about @ direction) * math.sin(angle)
    assert frontal == pytest.approx(tuple(foot + (base - foot) * distance / (distance - height)), abs=1e-3)


def test_without_tilt_image_and_frontal_view_are_identical():
    frontal = CameraTilt((600.0, 400.0), (0.0, 0.0), 5000.0, MIDDLE)
    assert frontal.image_from_frontal((123.0, 45.0)) == pytest.approx((123.0, 45.0))
    assert frontal.foot_px == MIDDLE
    assert frontal.angle_deg == 0
