import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.perception.oct.class_maps import Scaling
from haptigraph.perception.oct.class_needle import fit_needles

SAME = Scaling(1.0, 1.0, 0.015, 0.0066)


def fit_needle(on, scaling, least_confidence):
    return next(iter(fit_needles(on, scaling, least_confidence)), None)


def needle_map(tip, angle_deg, length=300.0, width=5, size=(256, 256)):
    """Probability of metal: a line drawn at four times the size and downsampled."""
    direction = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    start = tip[0] - length * direction[0], tip[1] - length * direction[1]
    canvas = np.zeros((4 * size[0], 4 * size[1]), np.uint8)
    end, begin = ([round((4 * (v + 0.5) - 0.5) * 16) for v in p] for p in (tip, start))
    cv2.line(canvas, begin, end, 255, 4 * width, cv2.LINE_AA, 4)
    small = cv2.resize(canvas, size[::-1], interpolation=cv2.INTER_AREA)
    return small.astype(np.float32) / 255


@given(st.floats(80, 180), st.floats(100, 200), st.floats(30, 150), st.integers(2, 5))
@settings(max_examples=40, deadline=None)
def test_line_and_tip_of_a_needle_are_found(x, y, angle_deg, width):
    found = fit_needle(needle_map((x, y), angle_deg, width=width), SAME, 0.5)
    along = np.subtract(found.tip_px, found.entry_px)
    assert math.degrees(math.atan2(along[1], along[0])) == pytest.approx(angle_deg, abs=0.5)
    assert math.dist(found.tip_px, (x, y)) < width / 2 + 1.0  # OpenCV draws a round end
    assert found.confidence > 0.7


def test_the_bevel_beyond_a_gap_still_belongs_to_the_needle():
    whole = needle_map((120.0, 160.0), 60.0)
    cut = whole.copy()
    cut[146:152] = 0
    found = fit_needle(cut, SAME, 0.5)
    assert math.dist(found.tip_px, fit_needle(whole, SAME, 0.5).tip_px) < 0.5


def test_a_soft_end_is_less_certain():
    sharp = needle_map((120.0, 160.0), 60.0)
    fade = np.clip((170 - np.arange(256)) / 40, 0, 1).astype(np.float32)[:, None]
    soft = fit_needle(sharp * fade, SAME, 0.5)
    assert soft.tip_sd_px > 2 * fit_needle(sharp, SAME, 0.5).tip_sd_px


def test_positions_are_in_pixels_of_the_image():
    found = fit_needle(needle_map((120.0, 160.0), 60.0), Scaling(2.0, 3.0, 0.0075, 0.0022), 0.5)
    same = fit_needle(needle_map((120.0, 160.0), 60.0), SAME, 0.5)
    assert found.tip_px == pytest.approx((2 * (same.tip_px[0] + 0.5) - 0.5, 3 * (same.tip_px[1] + 0.5) - 0.5))


def test_shapes_that_are_not_lines_are_rejected():
    nothing = np.zeros((256, 256), np.float32)
    assert fit_needle(nothing, SAME, 0.5) is None
    blob = cv2.circle(nothing.copy(), (100, 100), 20, 1.0, -1)
    assert fit_needle(blob, SAME, 0.5) is None
    specks = (np.random.default_rng(1).random((256, 256)) < 0.01).astype(np.float32)
    assert fit_needle(specks, SAME, 0.5) is None


def test_candidates_are_ordered_by_evidence():
    both = np.maximum(needle_map((120.0, 200.0), 60.0), needle_map((160.0, 90.0), 120.0))
    found = fit_needles(both, SAME, 0.5)
    assert [
        round(math.dist(fit.tip_px, tip)) <= 4
        for fit, tip in zip(found, ((120, 200), (160, 90)), strict=True)
    ]
    assert found[0].tip_px[1] > 190 > 100 > found[1].tip_px[1]


def test_a_line_shorter_than_a_fifth_of_a_millimetre_is_no_needle():
    """The same pixels are a needle in a wide scan, and a speck in a narrow one."""
    short = needle_map((120.0, 160.0), 60.0, length=40.0)
    assert fit_needle(short, SAME, 0.5) is not None
    assert fit_needle(short, Scaling(1.0, 1.0, 0.003, 0.002), 0.5) is None
