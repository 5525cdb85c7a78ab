import numpy as np
import pytest
from drawn_strip import END_PX, LANES, NOISE_GREY, U_PX, needle, strip
from msgspec.structs import replace

from haptigraph.perception.native.strip import colored_share
from haptigraph.perception.needle.coarse_tip import Cannulas, estimate_coarse_tip
from haptigraph.perception.needle.rectify import STATION_PX


@pytest.mark.parametrize(("gap", "where"), [(0, "inside"), (2, "outside")])
def test_a_needle_that_ends_before_known_background_does_not_enter_the_wall(gap, where):
    u_px = np.arange(-240, 100, STATION_PX, dtype=np.float32)
    shown = strip(np.zeros((len(LANES), len(u_px))), u_px)
    end, rim = shown.outside.stop - gap, shown.inside.start
    for part in (slice(0, end), slice(rim, rim + 2)):  # at the rim it looks like a tip when the light changes
        shown.planes[..., part] += 30.0 * (abs(LANES) <= 4)
    tip = estimate_coarse_tip(shown, px_per_mm=20.0, usual_grey=None)
    assert tip is not None
    assert tip.where == where


@pytest.mark.parametrize(("length_px", "where"), [(8, "occluded"), (30, "inside")])
def test_a_needle_beyond_a_cannula_that_was_always_there_is_inside(length_px, where):
    u_px = np.arange(-240, 200, STATION_PX, dtype=np.float32)
    shown = strip(np.zeros((len(LANES), len(u_px))), u_px)
    cannula = shown.inside.start + round(40 / STATION_PX)
    for part in (slice(0, shown.outside.stop), slice(cannula, cannula + round(length_px / STATION_PX))):
        shown.planes[..., part] += 30.0 * (abs(LANES) <= 4)
    tip = estimate_coarse_tip(shown, px_per_mm=20.0, usual_grey=None)
    assert tip is not None
    assert tip.where == where


def colored(beyond: float):
    """A shaft with a colour of 10 up to 100 px, and another beyond, where its contrast is lost."""
    noise = np.random.default_rng(8).normal(0, NOISE_GREY, (len(LANES), len(U_PX)))
    rest = needle(4, END_PX, beyond) * (U_PX > 100)
    shown, chroma = strip(needle(4, 100.0)), (needle(4, 100.0, 10.0) + rest + noise).astype(np.float32)
    return replace(shown, planes=np.stack([*shown.planes, chroma]))


@pytest.mark.parametrize(("beyond", "until_px"), [(4.5, END_PX), (-4.5, 100.0), (0.0, 100.0)])
def test_a_shaft_whose_contrast_is_lost_is_followed_by_its_own_colour(beyond, until_px):
    tip = estimate_coarse_tip(colored(beyond), px_per_mm=20.0, usual_grey=None)
    assert tip is not None
    assert tip.u_px == pytest.approx(until_px, abs=3 * STATION_PX)


@pytest.mark.parametrize(("beyond", "share"), [(10.0, 1.0), (-10.0, 0.0), (0.0, 0.0), (30.0, 0.0)])
def test_what_has_the_opposite_colour_or_far_more_of_it_is_not_the_shafts(beyond, share):
    part = slice(*(int(U_PX.searchsorted(px)) for px in (102, END_PX - 2)))
    assert colored_share(colored(beyond), part, 5.0, own=True) == pytest.approx(share, abs=0.1)
    assert colored_share(colored(beyond), part, 20.0, own=True) == 0


@pytest.mark.parametrize(
    ("outside_px", "length_px", "is_cannula"),
    [(0, 40, True), (12, 40, True), (100, 40, False), (0, 80, False)],
    ids=["stands free", "behind its hub", "a needle leads to it", "longer than any cannula"],
)
def test_something_short_in_the_globe_to_which_no_needle_leads_may_be_a_cannula(
    outside_px, length_px, is_cannula
):
    u_px = np.arange(-240, 200, STATION_PX, dtype=np.float32)
    shown = strip(np.zeros((len(LANES), len(u_px))), u_px)
    hub, foot = shown.outside.stop - round(outside_px / STATION_PX), shown.inside.start
    for part in (slice(hub, shown.outside.stop), slice(foot, foot + round(length_px / STATION_PX))):
        shown.planes[..., part] += 30.0 * (abs(LANES) <= 4)
    tip = estimate_coarse_tip(shown, px_per_mm=20.0, usual_grey=None)
    assert tip is not None
    cannulas = Cannulas(px_per_mm=20.0)
    assert not cannulas.may_hide(tip)
    cannulas.learn([(shown, tip)])
    assert cannulas.may_hide(tip) is cannulas.include(shown, tip) is is_cannula
    assert not cannulas.may_hide(replace(tip, u_px=tip.u_px + 4.0))
    assert cannulas.may_hide(replace(tip, where="outside", u_px=-30.0)) is is_cannula  # in its hub
    assert not cannulas.may_hide(replace(tip, where="outside", u_px=-50.0))
    cannulas.learn([])
    assert cannulas.may_hide(tip) is is_cannula
    cannulas.reset()
    assert not cannulas.may_hide(tip)
