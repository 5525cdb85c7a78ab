"""What an uncalibrated lens may do, for rims of known cameras."""

import math

import numpy as np
import pytest
from lens import edge_through, rim_seen, uncalibrated

from haptigraph.lens import Lens
from haptigraph.perception.anatomy.lens_risk import lens_risk_px

SIZE_PX = 1280, 720
MIDDLE = (639.5, 359.5)
IDEAL = Lens((1000.0, 1000.0), MIDDLE, (0.0,) * 5)


def barrel(share: float) -> Lens:
    side = 640 / 1000 / (1 + share)
    return Lens((1000.0, 1000.0), MIDDLE, (share / side**2, 0.0, 0.0, 0.0, 0.0))


def risk(lens: Lens, center_px, radius_px) -> float:
    rim = rim_seen(lens.distorted, center_px, radius_px, np.random.default_rng(1))
    return lens_risk_px(rim, None, SIZE_PX)


def test_a_small_eye_in_the_middle_is_safe_with_any_lens():
    for share in (-0.08, 0.0, 0.08):
        assert risk(barrel(share), MIDDLE, 180.0) < 1.5


def test_a_large_eye_off_the_middle_is_not_safe():
    assert risk(barrel(-0.08), (850.0, 400.0), 290.0) > 3


def test_the_risk_grows_with_the_eye_and_with_its_distance_from_the_middle():
    centred = [risk(IDEAL, MIDDLE, radius) for radius in (120.0, 200.0, 300.0)]
    assert centred == sorted(centred)
    assert risk(IDEAL, (840.0, 359.5), 200.0) > centred[1]


def test_an_edge_is_fitted_through_points():
    turns = np.linspace(0, 2 * math.pi, 100, endpoint=False)
    edge = edge_through(np.stack([300 + 50 * np.sin(turns), 200 + 50 * np.cos(turns)], axis=1))
    assert edge.center_px == pytest.approx((300, 200)) and edge.radius_px == pytest.approx(50)


def test_a_tilt_that_the_lens_turned_round_is_not_safe():
    """With its distortion the rim looks tilted by 11 degrees to one side; it is tilted by 4 to the other."""
    error_px, risk_px = uncalibrated(37, 1, seed=1)
    assert error_px > 3
    assert risk_px > 3
