"""The slant against a pinhole camera written out in space."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.registration.tilt import Slant

MIDDLE = (639.5, 359.5)
part_rad = st.floats(-0.3, 0.3)
place_px = st.tuples(st.floats(-250, 250), st.floats(-250, 250))
slants = st.builds(
    lambda x, y, right, down, focal: Slant((x, y), (right, down), focal, MIDDLE),
    st.floats(500, 800),
    st.floats(300, 450),
    part_rad,
    part_rad,
    st.floats(800, 1e5),
)


def photographed(tilt: Slant, at: np.ndarray, before: float = 0.0) -> np.ndarray:
    """Where the camera sees a place of the plane, or one that stands so far before it [px of the plane]."""
    angle = math.hypot(*tilt.tilt_rad)
    turn = np.eye(3)
    if angle:
        kx, ky = (
            -tilt.tilt_rad[1] / angle,
            tilt.tilt_rad[0] / angle,
        )  # the axis; z goes away from the camera
        cross = np.array([[0, 0, ky], [0, 0, -kx], [-ky, kx, 0]])
        turn += math.sin(-angle) * cross + (1 - math.cos(angle)) * cross @ cross
    start = np.array([*(np.array(tilt.about_px) - MIDDLE), tilt.focal_px])
    x, y, z = start + turn @ np.array([*at, -before])
    return np.array(MIDDLE) + tilt.focal_px * np.array([x, y]) / z


@given(slants, place_px)
def test_a_place_is_seen_where_a_pinhole_camera_sees_it(tilt, at):
    seen = tilt.image_from_frontal((tilt.about_px[0] + at[0], tilt.about_px[1] + at[1]))
    assert seen == pytest.approx(tuple(photographed(tilt, np.array(at))), abs=1e-6)
    back = tilt.frontal_from_image(seen)
    assert back == pytest.approx((tilt.about_px[0] + at[0], tilt.about_px[1] + at[1]), abs=1e-6)


@given(slants, place_px, st.floats(0.0, 60.0))
def test_what_stands_before_the_plane_is_seen_further_from_the_foot(tilt, at, before):
    # In the straight picture, as far as the foot is concerned: by distance / (distance - before).
    seen = tilt.frontal_from_image(tuple(photographed(tilt, np.array(at), before)))
    foot = np.array(tilt.foot_px)
    under = np.array(tilt.about_px) + at
    tilt = math.hypot(*tilt.tilt_rad)
    off = np.array(tilt.about_px) - MIDDLE
    away = np.array(tilt.tilt_rad) / tilt if tilt else np.zeros(2)
    height = tilt.focal_px * math.cos(tilt) - float(off @ away) * math.sin(tilt)
    assert seen == pytest.approx(tuple(foot + (under - foot) * height / (height - before)), abs=1e-3)


def test_without_tilt_both_pictures_are_one():
    frontal = Slant((600.0, 400.0), (0.0, 0.0), 5000.0, MIDDLE)
    assert frontal.image_from_frontal((123.0, 45.0)) == pytest.approx((123.0, 45.0))
    assert frontal.foot_px == MIDDLE
    assert frontal.angle_deg == 0
