import math

import numpy as np
import pytest
from drawn_strip import strip as drawn_strip
from drawn_strip import strip_of
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from msgspec.structs import replace

from haptigraph.perception.needle.coarse_tip import estimate_coarse_tip
from haptigraph.perception.needle.rectify import STATION_PX, UNOBSERVED, Line, rectify
from haptigraph.perception.needle.shaft_line import Appearance, fit_line
from haptigraph.perception.needle.subpixel_tip import refine_tip


def slope_of_grey(eye, grey):
    """Ground that gets brighter to the right and darker downwards."""
    y, x = np.mgrid[: eye.height_px, : eye.width_px]
    return grey + 0.1 * x - 0.05 * y


@pytest.mark.parametrize("turn_rad", [-0.3, 0.0, 0.4])
@pytest.mark.parametrize("share", [0.8, 1.0, 1.2])
def test_subtracts_the_background_completely_in_other_light(eye, turn_rad, share):
    ground = slope_of_grey(eye, 90)
    image = np.clip(share * ground, 0, 255).astype(np.uint8)
    line = Line(eye.inwards_rad + turn_rad, 1.5)
    strip = strip_of(eye, image, ground.astype(np.float32), line)
    assert np.abs(strip.excess).max() < 1.0
    assert np.abs(strip.detrended).max() < 1.0
    assert strip.is_known.all()


def test_subtracts_nothing_where_the_background_is_unknown(eye):
    ground = slope_of_grey(eye, 90).astype(np.float32)
    ground[:, : eye.width_px // 2] = UNOBSERVED
    image = np.full(ground.shape, 100, np.uint8)
    line = Line(eye.inwards_rad, 0.0)
    strip = strip_of(eye, image, ground, line)
    assert np.array_equal(strip.excess[:, ~strip.is_known], strip.detrended[:, ~strip.is_known])


def test_an_image_continues_beyond_its_border(eye):
    line = Line(eye.inwards_rad, 0.0)
    far_px = np.arange(3000, 3100, STATION_PX, dtype=np.float32)
    image = np.random.default_rng(0).integers(0, 255, (eye.height_px, eye.width_px, 3), np.uint8)
    (strip,) = rectify(eye, image, np.full(image.shape[:2], UNOBSERVED, np.float32), line, far_px)
    assert np.ptp(strip.detrended, axis=1).max() < 1e-3


def test_grey_with_chroma_is_brighter_where_it_is_bluer_within_the_globe_alone(eye):
    line = Line(eye.inwards_rad, 0.0)
    image = np.full((eye.height_px, eye.width_px, 3), 100, np.uint8)
    (x, y), (dx, dy) = eye.trocar_px, line.direction
    rows, columns = np.mgrid[: eye.height_px, : eye.width_px]
    image[np.abs((columns - x) * dy - (rows - y) * dx) < 3] = 120, 100, 80
    unknown = np.full(image.shape[:2], UNOBSERVED, np.float32)
    strip = strip_of(eye, image, unknown, line, chroma_share=0.4)
    middle = strip.detrended[eye.half_px]
    assert middle[strip.inside] == pytest.approx(12.3, abs=0.6)
    assert middle[strip.outside] == pytest.approx(-3.7, abs=0.6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"is_known": np.ones(3, bool)}, r"is_known: expected contiguous bool of shape \(170,\); found"),
        ({"u_px": np.arange(170.0)}, "u_px: expected contiguous float32 of shape"),
        ({"inside": slice(9, 170)}, "expected two parts of 170 stations"),
        ({"inside": slice(20, 171)}, "expected two parts of 170 stations"),
        (
            {"planes": np.zeros((2, 33, 170))},
            r"planes: expected \(lanes, stations\) of float32 .*; found float64",
        ),
    ],
    ids=["too short", "doubles", "overlapping", "too long", "pixels of doubles"],
)
def test_refuses_a_strip_whose_parts_do_not_fit(change, message):
    with pytest.raises(ValueError, match=message):
        replace(drawn_strip(np.zeros((33, 170))), **change)


@given(
    arrays(np.float32, (33, 170), elements=st.floats(-255, 255, width=32), fill=st.floats(-9, 9, width=32)),
    st.integers(0, 170),
    st.integers(0, 170),
    st.floats(-60, 400),
)
def test_whatever_a_strip_shows_the_estimates_are_possible(excess, one, other, about_px):
    outside, inside = slice(0, min(one, other)), slice(min(one, other), max(one, other))
    strip = replace(
        drawn_strip(np.zeros((33, 170))), planes=np.stack([excess] * 2), outside=outside, inside=inside
    )
    tip_estimate = estimate_coarse_tip(strip, 20.0, None)
    assert tip_estimate is None or strip.u_px[0] <= tip_estimate.u_px <= strip.u_px[-1]
    fit = fit_line(strip, about_px, 16.0, Appearance(highlight=(0.1, 0.2), shaded_px=(None, 0.1)))
    if fit is not None:
        assert math.isfinite(fit.offset_px + fit.slope + sum(fit.covariance) + fit.width_px + fit.blur_px)
        assert 0 < fit.confidence <= 1
        assert len(fit.u_px) == len(fit.is_on_line) == len(fit.is_steep)
    tip = tip_estimate and refine_tip(strip, tip_estimate, about_px)
    assert tip is None or math.isfinite(tip.u_px + tip.sd_px + tip.contrast_grey)
