"""Standard deviations of tips, and tips whose place is not known, on drawn shafts."""

import math

import numpy as np
import pytest
from drawn_strip import END_PX, LANES, U_PX, needle, strip
from msgspec.structs import replace

from haptigraph.config import PerceptionConfig
from haptigraph.perception.needle.coarse_tip import TipEstimate
from haptigraph.perception.needle.sharp_tip import sharp_end
from haptigraph.perception.needle.tip_certainty import MAX_SD_MM, outside_globe, with_certainty
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario
from haptigraph.sources.phantom import capture_of

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
    fading = needle(4) * np.clip((END_PX + 8 - U_PX) / 40, 0.2, 1)
    assert certain(fading, faint).shift_sd_px > certain(needle(4, grey=-8.0), faint).shift_sd_px
    assert certain(needle(4), edges_end_px=END_PX - 15).shift_sd_px > 2.5


def test_a_point_as_clear_in_colour_as_its_shaft_does_not_fade():
    """A grey needle on an orange bowl differs little in grey, and as much in colour up to its end."""
    faint = TipEstimate("inside", END_PX, 100.0, sd_px=0.2, contrast_grey=16.0)
    drawn = strip(needle(4, grey=-16.0))
    colored = replace(drawn, chroma=np.asarray(drawn.excess + needle(4, grey=64.0), np.float32))
    tip = with_certainty(colored, faint, END_PX, END_PX, 0.6, PX_PER_MM)
    assert tip.is_known
    assert tip.shift_sd_px == pytest.approx(certain(needle(4, grey=-16.0), faint).shift_sd_px, rel=0.2)


def test_the_end_of_what_is_sharp_has_the_certainty_of_its_contrast():
    shaft = needle(4, grey=-60.0)
    shadow = -30.0 * np.exp(-((LANES / 9) ** 2)) * (U_PX <= END_PX + 80)
    drawn = strip(np.minimum(shaft, shadow))
    end = sharp_end(drawn, TipEstimate("inside", END_PX + 80, 100.0))
    assert end is not None and end.u_px == pytest.approx(END_PX, abs=3.0)
    assert end.contrast_grey == pytest.approx(60, abs=15)


def test_a_tip_that_may_be_elsewhere_is_not_known():
    longer = needle(4, END_PX + 60)
    assert not certain(longer, until_px=END_PX + 60).is_known


def test_a_shadow_beyond_a_tip_leaves_it_known():
    shadow = needle(4) + 0.2 * needle(4, END_PX + 60) * (END_PX < U_PX)
    assert certain(shadow, until_px=END_PX + 60).is_known


def test_a_faint_point_in_a_compressed_picture_may_go_on():
    clear, faint = (
        with_certainty(
            *(strip(needle(4, grey=grey)), replace(TIP, contrast_grey=grey)),
            *(END_PX, END_PX, 0.6, PX_PER_MM),
            quantum_grey=22.0,
        )
        for grey in (60.0, 6.0)
    )
    assert clear.is_known and clear.shift_sd_px < 0.5
    assert not faint.is_known and faint.shift_sd_px > MAX_SD_MM * PX_PER_MM
    assert certain(needle(4, grey=6.0), replace(TIP, contrast_grey=6.0)).is_known


def test_a_tip_that_noise_puts_anywhere_is_not_known():
    noisy = TipEstimate("inside", END_PX, 100.0, sd_px=2 * MAX_SD_MM * PX_PER_MM, contrast_grey=40.0)
    assert not certain(needle(4), noisy).is_known


@pytest.mark.parametrize("start", [0, 20])
def test_a_shaft_too_short_to_measure_what_is_behind_has_a_certainty(start):
    drawn = strip(needle(4))
    first = float(drawn.u_px[drawn.inside.start])
    tip = TipEstimate("inside", first + start / 10, 5.0, sd_px=0.2, contrast_grey=40.0)
    assert np.isfinite(with_certainty(drawn, tip, first, first, 0.6, PX_PER_MM).shift_sd_px)


def test_a_tip_outside_the_globe_is_uncertain_by_its_point_unless_its_end_shows():
    located = replace(TIP, where="outside", contrast_grey=30.0)
    assert outside_globe(located, 20.0).shift_sd_px == pytest.approx(0.6)
    unlocated = outside_globe(replace(located, contrast_grey=0.0), 20.0)
    assert unlocated.shift_sd_px == pytest.approx(32.0) and unlocated.is_known


def test_a_needle_that_stands_outside_from_the_first_image_on_is_within_two_standard_deviations():
    phantom = Phantom(load_scenario("bent_needle")).paint()
    tracker = Tracker(parse_registration(phantom.registration, "phantom"), PerceptionConfig())
    within = []
    for index in range(30):
        moment = phantom.advance()
        observation = tracker(capture_of(moment, index, round(moment.time_s * 1e9)))
        error_mm = math.dist(observation.found["needle_tip"].at_mm, moment.truth.tip_mm)
        within.append(error_mm <= 2 * observation.certainty.tip_sd_mm)
    assert np.mean(within[8:]) > 0.9


def test_near_the_far_wall_a_point_may_mirror_it():
    drawn = strip(needle(4))
    wall = int(U_PX.searchsorted(END_PX + 0.3 * PX_PER_MM))
    near = replace(drawn, inside=slice(drawn.inside.start, wall))
    far = replace(drawn, inside=slice(drawn.inside.start, len(U_PX) - 1))
    tips = [with_certainty(each, TIP, END_PX, END_PX, 0.6, PX_PER_MM) for each in (near, far)]
    assert tips[0].shift_sd_px > tips[1].shift_sd_px + 0.5
    assert tips[0].is_known


def test_a_faint_rest_that_may_belong_to_the_point_counts():
    plain = certain(needle(4))
    faint = with_certainty(strip(needle(4)), TIP, END_PX + 3, END_PX, 0.6, PX_PER_MM, rest_px=3.0)
    assert faint.shift_sd_px == pytest.approx(math.hypot(plain.shift_sd_px, 3.0), rel=0.05)


def test_a_bright_blunt_tip_is_usually_beyond_what_shows_and_less_certain():
    plain = certain(needle(4, grey=40.0))
    blunt = with_certainty(strip(needle(4, grey=40.0)), TIP, END_PX, END_PX, 0.6, PX_PER_MM, blunt_px=8.0)
    assert plain.hidden_px == 0.0 and plain.u_px == blunt.u_px
    assert 0.5 < blunt.hidden_px < 2.0
    assert blunt.shift_sd_px == pytest.approx(math.hypot(plain.shift_sd_px, blunt.hidden_px), rel=0.01)
