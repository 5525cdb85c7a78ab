import numpy as np
import pytest
from drawn_strip import END_PX, LANES, NOISE_GREY, SHADOW, U_PX, blurred, needle, strip

from haptigraph.perception.native.strip import profile_share
from haptigraph.perception.needle.rectify import STATION_PX
from haptigraph.perception.needle.shaft_line import fit_line
from haptigraph.perception.needle.shaft_profile import ShaftProfile

PX_PER_MM = 20.0
SHAFT = slice(30, 70)  # stations


def seen(excess):
    drawn = strip(excess)
    return drawn, fit_line(drawn, END_PX, drawn.half_px)


def noisy(excess, seed: int):
    """A strip with other noise than that which `strip` adds to all alike."""
    noise, usual = (np.random.default_rng(s).normal(0, NOISE_GREY, excess.shape) for s in (seed, 7))
    return strip(excess + noise - usual)


def soft_point(rest_px: float, grey: float = -20.0):
    """A needle whose last part is out of its edges' sharpness, as poor compression leaves it."""
    rest = needle(3.0, END_PX + rest_px, grey) * (U_PX > END_PX)
    return needle(3.0) + blurred(rest, 2.0, STATION_PX)


@pytest.mark.parametrize("grey", [-40.0, 25.0])
def test_a_shaft_shows_all_of_its_profile_and_its_ground_none(grey):
    drawn = strip(needle(3.0, grey=grey))
    share, sd, *_ = profile_share(drawn, 0.0, 0.0, 8, SHAFT, slice(70, 80))
    assert share == pytest.approx(1.0, abs=5 * sd)
    assert profile_share(drawn, 0.0, 0.0, 8, SHAFT, slice(110, 120))[0] == pytest.approx(0.0, abs=5 * sd)


def test_the_standard_deviation_of_a_share_is_that_of_many_strips():
    excess = needle(3.0, grey=-8.0)
    shares = []
    for seed in range(200):
        share, sd, *_ = profile_share(noisy(excess, seed), 0.0, 0.0, 8, SHAFT, slice(110, 114))
        shares.append(share)
    assert np.std(shares) == pytest.approx(sd, rel=0.25)


def test_follows_a_shaft_across_the_lanes():
    slope, offset_px = 0.05, -4.0
    across = np.clip(3.5 - abs(LANES - offset_px - slope * U_PX), 0, 1)
    drawn = strip(-40.0 * across)
    assert profile_share(drawn, offset_px, slope, 8, SHAFT, slice(120, 130))[0] > 0.9
    assert profile_share(drawn, 0.0, 0.0, 3, SHAFT, slice(120, 130))[0] < 0.7


@pytest.mark.parametrize("parts", [(slice(5, 5), slice(9, 12)), (slice(5, 9), slice(12, 12))])
def test_without_stations_there_is_no_share(parts):
    share, sd, *others = profile_share(strip(needle(3.0)), 0.0, 0.0, 8, *parts)
    assert np.isnan(share) and sd == np.inf and others == [0]


def test_what_does_not_stand_out_of_the_noise_has_no_profile():
    drawn = strip(needle(3.0, grey=-0.2))
    assert np.isnan(profile_share(drawn, 0.0, 0.0, 8, slice(60, 68), slice(70, 71))[0])


def fading(rest, rest_px: float):
    """A drawn rest that fades to nothing over its length."""
    return needle(3.0) + (rest - needle(3.0)) * np.clip((END_PX + rest_px - U_PX) / rest_px, 0, 1)


@pytest.mark.parametrize("grey", [-20.0, -30.0])
def test_a_soft_point_has_the_profile_of_its_shaft_and_fades(grey):
    drawn, fit = seen(fading(soft_point(30.0, grey), 30.0))
    assert ShaftProfile(drawn, fit, PX_PER_MM).fades(END_PX, END_PX + 30)


@pytest.mark.parametrize("rest_px", [30.0, 80.0])
def test_an_even_rest_is_a_shadow_however_much_of_the_profile_it_has(rest_px):
    drawn, fit = seen(soft_point(rest_px, -30.0))
    assert ShaftProfile(drawn, fit, PX_PER_MM).continues(END_PX, softly=True)
    assert not ShaftProfile(drawn, fit, PX_PER_MM).fades(END_PX, END_PX + rest_px)


def test_a_long_rest_is_a_shadow_though_it_fades():
    drawn, fit = seen(fading(soft_point(80.0, -30.0), 80.0))
    assert not ShaftProfile(drawn, fit, PX_PER_MM).fades(END_PX, END_PX + 80)


def test_a_soft_shadow_that_fades_has_not_the_profile_of_the_shaft():
    shadow = -15.0 * (SHADOW - SHADOW.mean()) * ((END_PX + 30 >= U_PX) & (U_PX > END_PX))
    drawn, fit = seen(fading(needle(3.0) + shadow, 30.0))
    assert not ShaftProfile(drawn, fit, PX_PER_MM).continues(END_PX, softly=True)
    assert not ShaftProfile(drawn, fit, PX_PER_MM).fades(END_PX, END_PX + 30)


def test_a_profile_continues_where_it_does_not_drop():
    drawn, fit = seen(needle(3.0))
    assert ShaftProfile(drawn, fit, PX_PER_MM).continues(END_PX - 20)
    assert not ShaftProfile(drawn, fit, PX_PER_MM).continues(END_PX)
    hard_shadow, fit = seen(needle(3.0) + needle(3.0, END_PX + 60, -12.0) * (U_PX > END_PX))
    assert not ShaftProfile(hard_shadow, fit, PX_PER_MM).continues(END_PX)


def test_a_shaft_too_short_to_have_a_profile_says_nothing():
    drawn = strip(needle(3.0, 14.0))
    _, fit = seen(needle(3.0))
    assert not ShaftProfile(drawn, fit, PX_PER_MM).fades(14.0, 20.0)
    assert not ShaftProfile(drawn, fit, PX_PER_MM).continues(14.0)


HIGHLIGHT_PX = END_PX - 30.0
"""Where the highlight of a shaft with dark rims ends."""


def rims(beyond):
    """A bright middle between dark rims up to the end of the highlight, and then something else."""
    before = np.where(abs(LANES) <= 1, 60.0, needle(4.0, grey=-25.0))
    return np.where(U_PX <= HIGHLIGHT_PX, before, beyond)


def goes_on(beyond) -> bool:
    drawn, fit = seen(rims(beyond))
    return ShaftProfile(drawn, fit, PX_PER_MM).rims_continue(HIGHLIGHT_PX, END_PX)


@pytest.mark.parametrize("grey", [-25.0, -12.0])
def test_a_shaft_whose_highlight_ends_goes_on_as_far_as_both_of_its_rims(grey):
    dark = needle(4.0, grey=grey)
    assert goes_on(np.where(abs(LANES) <= 1, 0.0, dark))
    assert not goes_on(np.where(LANES <= 1, 0.0, dark))
    assert not goes_on(dark)  # a shadow is darkest in its middle
    assert not goes_on(0 * dark)


@pytest.mark.parametrize("grey", [-40.0, 60.0])
def test_a_shaft_of_one_tone_has_no_rims(grey):
    drawn, fit = seen(needle(4.0, grey=grey))
    assert not ShaftProfile(drawn, fit, PX_PER_MM).rims_continue(HIGHLIGHT_PX, END_PX)


@pytest.mark.parametrize("gap_px", [0.0, 6.0, 16.0])
@pytest.mark.parametrize("fades_px", [0.0, 30.0])
def test_a_shaft_is_seen_beyond_a_gap_also_if_it_fades_then(gap_px, fades_px):
    end_px = END_PX + gap_px + 20
    is_hidden = (U_PX > END_PX) & (END_PX + gap_px >= U_PX)
    left = np.clip((end_px + fades_px - U_PX) / 30, 0, 1) if fades_px else 1.0
    drawn = strip(needle(3.0, end_px + fades_px, 60.0) * ~is_hidden * left)
    profile = ShaftProfile(drawn, seen(needle(3.0, grey=60.0))[1], PX_PER_MM)
    assert profile.is_seen(END_PX, end_px + fades_px)
    assert not profile.is_seen(END_PX, END_PX + gap_px)


@pytest.mark.parametrize("blur_px", [0.5, 2.5])
def test_nothing_is_not_seen_beyond_an_end_nor_is_its_blur(blur_px):
    drawn, fit = seen(blurred(needle(3.0, grey=60.0), blur_px, STATION_PX))
    assert not ShaftProfile(drawn, fit, PX_PER_MM).is_seen(END_PX, END_PX + 40)
