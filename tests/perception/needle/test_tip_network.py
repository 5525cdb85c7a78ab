"""Standard deviations of tips, and tips whose place is not known, on drawn shafts."""

import math

import numpy as np
import pytest
from drawn_strip import END_PX, STATION_PX, U_PX, blurred, needle, strip
from msgspec.structs import replace

from haptigraph.config import PerceptionConfig
from haptigraph.perception.needle.coarse_tip import TipEstimate
from haptigraph.perception.needle.shaft_line import fit_line
from haptigraph.perception.needle.tip_network import TipJudge
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario
from haptigraph.sources.phantom import capture_of

PX_PER_MM = 20.0
TIP = TipEstimate("inside", END_PX, 100.0, sd_px=0.2, contrast_grey=40.0)


def certain(excess, at_px: float = END_PX, judge: TipJudge | None = None) -> TipEstimate:
    drawn, plain = strip(blurred(excess, 0.7, STATION_PX)), strip(needle(4))
    fit = fit_line(plain, END_PX, plain.half_px)
    return (judge or TipJudge()).judged(drawn, fit, replace(TIP, u_px=at_px), PX_PER_MM)


@pytest.mark.parametrize("grey", [-40.0, 60.0])
def test_a_clear_end_is_known_to_a_pixel(grey):
    tip = certain(needle(4, grey=grey))
    assert tip.is_known
    assert abs(tip.u_px - END_PX) < max(1.0, 2 * tip.shift_sd_px)
    assert tip.shift_sd_px < 1.2


@pytest.mark.parametrize("off_px", [-12.0, 12.0])
def test_a_step_that_is_not_the_end_is_not_the_tip(off_px):
    tip = certain(needle(4), END_PX + off_px)
    assert abs(tip.u_px - END_PX) < 3 * tip.shift_sd_px
    assert not tip.is_known or abs(tip.u_px - END_PX) < 3


def test_a_tip_far_before_the_end_of_its_shaft_is_not_known():
    assert not certain(needle(4, END_PX + 80)).is_known


def test_a_clear_end_is_known_again_only_some_images_after_a_doubtful_one():
    judge = TipJudge()
    assert not certain(needle(4, END_PX + 80), judge=judge).is_known
    known = [certain(needle(4), judge=judge).is_known for _ in range(10)]
    assert not known[0] and known == sorted(known) and known[-1]
    assert not certain(
        needle(4, END_PX + 80), judge=judge
    ).is_known  # no history makes up for a doubt as great
    judge.forget()
    assert certain(needle(4), judge=judge).is_known


def test_a_faint_end_is_less_certain():
    plain, faint = certain(needle(4)), certain(needle(4, grey=-5.0))
    assert not faint.is_known or faint.shift_sd_px > plain.shift_sd_px


def test_a_shaft_that_the_strip_hardly_shows_has_a_certainty():
    drawn = strip(needle(4))
    fit = fit_line(drawn, END_PX, drawn.half_px)
    for at_px in (float(drawn.u_px[drawn.inside.start]), float(drawn.u_px[-1]) + 500):
        tip = TipJudge().judged(drawn, fit, replace(TIP, u_px=at_px), PX_PER_MM)
        assert np.isfinite(tip.u_px) and np.isfinite(tip.shift_sd_px)


def judged_outside(excess, at_px: float = END_PX) -> TipEstimate:
    """A needle before the globe, which begins beyond the strip."""
    drawn, whole = strip(excess), slice(0, len(U_PX))
    before = replace(drawn, outside=whole, inside=slice(len(U_PX), len(U_PX)))
    fit = fit_line(drawn, END_PX, drawn.half_px)
    return TipJudge().judged(before, fit, replace(TIP, where="outside", u_px=at_px), PX_PER_MM)


def test_a_tip_outside_the_globe_is_certain_where_its_end_shows():
    clear, early = judged_outside(needle(4)), judged_outside(needle(4, END_PX + 30))
    assert abs(clear.u_px - END_PX) < 2 and clear.shift_sd_px < 1.5
    assert abs(early.u_px - END_PX - 30) < 3 * early.shift_sd_px
    assert clear.is_known and early.is_known  # that it is outside is certain


def test_a_tip_outside_is_before_the_wall():
    assert judged_outside(needle(4, 500.0), float(U_PX[-1]) - 4).u_px <= U_PX[-1]


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
