"""Standard deviations of tips, and tips whose place is not known, on drawn shafts."""

import numpy as np
import pytest
from drawn_strip import END_PX, U_PX, needle, strip

from haptigraph.perception.needle.coarse_tip import TipEstimate
from haptigraph.perception.needle.tip_certainty import MAX_SD_MM, with_certainty

PX_PER_MM = 20.0
TIP = TipEstimate("inside", END_PX, 100.0, sd_px=0.2, contrast_grey=40.0)


def certain(excess, tip=TIP, until_px=END_PX, edges_end_px=END_PX, blur_px=0.6) -> TipEstimate:
    return with_certainty(strip(excess), tip, until_px, edges_end_px, blur_px, PX_PER_MM)


def test_a_blunt_end_in_focus_is_known_to_half_a_pixel():
    tip = certain(needle(4))
    assert tip.is_known and tip.u_px == END_PX
    assert 0 < tip.shift_sd_px < 0.5


def test_blur_a_faint_end_and_a_fading_point_make_a_tip_less_certain():
    plain = certain(needle(4)).shift_sd_px
    faint = TipEstimate("inside", END_PX, 100.0, sd_px=0.2, contrast_grey=8.0)
    assert certain(needle(4), blur_px=3.0).shift_sd_px > 2 * plain
    assert certain(needle(4, grey=-8.0), faint).shift_sd_px > 2 * plain  # in noise
    assert certain(needle(4), faint).shift_sd_px > certain(needle(4, grey=-8.0), faint).shift_sd_px
    assert certain(needle(4), edges_end_px=END_PX - 15).shift_sd_px > 2.5


def test_a_tip_that_may_be_elsewhere_is_not_known():
    longer = needle(4, END_PX + 60)
    assert not certain(longer, until_px=END_PX + 60).is_known


def test_a_shadow_beyond_a_tip_leaves_it_known():
    shadow = needle(4) + 0.2 * needle(4, END_PX + 60) * (END_PX < U_PX)
    assert certain(shadow, until_px=END_PX + 60).is_known


def test_a_tip_that_noise_puts_anywhere_is_not_known():
    noisy = TipEstimate("inside", END_PX, 100.0, sd_px=2 * MAX_SD_MM * PX_PER_MM, contrast_grey=40.0)
    assert not certain(needle(4), noisy).is_known


@pytest.mark.parametrize("start", [0, 20])
def test_a_shaft_too_short_to_measure_what_is_behind_has_a_certainty(start):
    drawn = strip(needle(4))
    first = float(drawn.u_px[drawn.inside.start])
    tip = TipEstimate("inside", first + start / 10, 5.0, sd_px=0.2, contrast_grey=40.0)
    assert np.isfinite(with_certainty(drawn, tip, first, first, 0.6, PX_PER_MM).shift_sd_px)
