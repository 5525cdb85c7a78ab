import cv2
import numpy as np
import pytest

from haptigraph.perception.closeup import refine_tip
from haptigraph.perception.shaft import Look, fit_line
from haptigraph.perception.sharp_end import dim_end_px, goes_on, sharp_end
from haptigraph.perception.strip import STATION_PX, Strip
from haptigraph.perception.tip import Reach, find_reach

HALF_PX, NOISE_GREY, END_PX = 16, 2.0, 140.0
LANES = np.arange(-HALF_PX, HALF_PX + 1)[:, None]
U_PX = np.arange(-40, 300, STATION_PX, dtype=np.float32)
SHADOW = np.exp(-((LANES / 9) ** 2))  # edges as soft as those of a lamp's shadow


def strip(excess, u_px=U_PX):
    noise = np.random.default_rng(7).normal(0, NOISE_GREY, excess.shape)
    seen = (excess + noise).astype(np.float32)
    first = int(u_px.searchsorted(8))
    before, inside = slice(0, max(first - 14, 0)), slice(first, len(u_px))
    return Strip(u_px, HALF_PX, seen, seen, np.ones(len(u_px), bool), before, inside, NOISE_GREY)


def needle(half_width_px, until_px=END_PX, grey=-40.0):
    across = np.clip(half_width_px + 0.5 - abs(LANES), 0, 1)
    return grey * across * (until_px >= U_PX)


@pytest.mark.parametrize("half_width_px", [1.5, 3.0, 8.0])
@pytest.mark.parametrize("shadow_grey", [-20.0, -50.0])
def test_a_shadow_that_goes_on_in_line_with_the_needle_is_cut_off(half_width_px, shadow_grey):
    shaded = np.minimum(needle(half_width_px), shadow_grey * SHADOW * (U_PX <= 220))
    shaded += needle(half_width_px, grey=-15.0)
    end = sharp_end(strip(shaded), Reach("inside", 220.0, 200.0))
    assert end is not None
    assert end.tip_px == pytest.approx(END_PX, abs=4)


@pytest.mark.parametrize("half_width_px", [1.5, 3.0, 8.0])
def test_a_needle_that_is_sharp_up_to_its_tip_keeps_it(half_width_px):
    assert sharp_end(strip(needle(half_width_px)), Reach("inside", END_PX, 100.0)) is None


def test_a_shaft_of_which_nothing_is_sharp_keeps_its_tip():
    blurred = -30 * np.exp(-((LANES / 6) ** 2)) * (END_PX >= U_PX)
    assert sharp_end(strip(blurred), Reach("inside", END_PX, 100.0)) is None


def test_a_needle_that_fades_in_the_noise_keeps_its_tip():
    fading = needle(1.5) * np.clip((END_PX - U_PX) / 100, 0, 1)
    assert sharp_end(strip(fading), Reach("inside", END_PX, 100.0)) is None


@pytest.mark.parametrize("tip_px", [9.0, 12.0, 20.0])
def test_a_tip_right_behind_the_wall_is_left_alone(tip_px):
    assert sharp_end(strip(needle(3.0, tip_px)), Reach("inside", tip_px, 10.0)) is None


@pytest.mark.parametrize("half_width_px", [2.0, 4.0])
@pytest.mark.parametrize("dim_px", [7, 12])
@pytest.mark.parametrize("grey", [-60.0, 60.0])
def test_a_point_that_gets_dim_before_its_end_is_followed_to_it(half_width_px, dim_px, grey):
    u_px = np.arange(100, 170, dtype=np.float32)
    across = np.clip(half_width_px + 0.5 - abs(LANES), 0, 1)
    lit = np.where(u_px <= END_PX - dim_px, 1, 0.45) * (u_px <= END_PX)
    seen = strip(cv2.GaussianBlur(grey * across * lit, (0, 0), 0.8), u_px)
    reach = Reach("inside", END_PX - dim_px, 100.0, contrast_grey=60.0)
    end_px = dim_end_px(seen, reach)
    assert end_px == pytest.approx(END_PX, abs=1.5)
    end = refine_tip(seen, reach, end_px, behinds_px=(6,))
    assert end.tip_px == pytest.approx(END_PX, abs=1.2)


@pytest.mark.parametrize("shadow_grey", [-15.0, -30.0])
def test_a_shadow_is_no_dim_point(shadow_grey):
    u_px = np.arange(100, 170, dtype=np.float32)
    across = np.clip(3.5 - abs(LANES), 0, 1)
    shaded = np.minimum(-60 * across * (u_px <= END_PX), shadow_grey * SHADOW * (u_px <= END_PX + 10))
    reach = Reach("inside", END_PX, 100.0, contrast_grey=60.0)
    assert dim_end_px(strip(shaded, u_px), reach) is None


def test_what_ends_where_its_contrast_falls_is_no_dim_point():
    reach = Reach("inside", END_PX, 100.0, contrast_grey=40.0)
    assert dim_end_px(strip(needle(3.0)), reach) is None


def shaded_shaft(side, shade_grey):
    half_px = np.clip((END_PX + 60 - U_PX) / 20, 0.0, 5.0)
    lit = np.clip(half_px + 0.5 - abs(LANES), 0, 1)
    shone = np.clip(half_px * 0.4 + 0.5 - abs(side * LANES - half_px * 0.5), 0, 1)
    return strip(cv2.GaussianBlur(shade_grey * lit + (130 - shade_grey) * shone, (0, 0), 0.8))


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("shade_grey", [40.0, 60.0])
def test_the_axis_of_a_shaft_is_between_its_outer_edges_though_one_side_is_in_the_shade(side, shade_grey):
    seen = shaded_shaft(side, shade_grey)
    fit = fit_line(seen, END_PX, seen.half_px)
    assert fit.width_px == pytest.approx(10, abs=2)
    assert fit.offset_px == pytest.approx(0, abs=0.5)
    assert fit.offset_px + fit.slope * END_PX == pytest.approx(0, abs=0.5)


@pytest.mark.parametrize(("images", "width_px"), [(0, 10), (7, 10), (9, 5), (15, 5), (16, 10)])
def test_feet_are_tried_in_the_first_images_and_seldom_once_they_were_no_better(images, width_px):
    seen = shaded_shaft(1, 40.0)
    fit = fit_line(seen, END_PX, seen.half_px, Look(images=images))
    assert fit.width_px == pytest.approx(width_px, abs=2)
    assert fit.look.images == (0 if width_px == 10 else images + 1)


def seen_blur_px(half_width_px, grey, blur_px):
    """Blur across the edges of a shaft like this, as the line's fit tells it."""
    shaft = cv2.GaussianBlur(needle(half_width_px, grey=grey), (0, 0), blur_px / STATION_PX, sigmaY=blur_px)
    seen = strip(shaft)
    return fit_line(seen, END_PX, seen.half_px).blur_px


@pytest.mark.parametrize("half_width_px", [3.0, 5.0])
@pytest.mark.parametrize("grey", [-80.0, 80.0])
def test_the_blur_across_a_shaft_is_told(half_width_px, grey):
    for blur_px in (0.8, 1.2, 1.6):
        assert seen_blur_px(half_width_px, grey, blur_px) == pytest.approx(blur_px, abs=0.25)


@pytest.mark.parametrize("blur_px", [0.8, 1.5, 2.2])
@pytest.mark.parametrize("shine_grey", [0.0, 140.0, 170.0, 300.0])
def test_a_thin_point_ends_where_it_ends_whatever_shines_on_its_middle(blur_px, shine_grey):
    u_px = np.arange(80, 160, dtype=np.float32)
    half_px = np.where(u_px <= 120.3, 1.5 + (120.3 - u_px) / 12, 0)
    across = np.clip(half_px + 0.5 - abs(LANES), 0, 1) * np.clip(120.8 - u_px, 0, 1)
    shine = shine_grey * np.exp(-((LANES / np.maximum(half_px / 3, 0.5)) ** 2))
    point = cv2.GaussianBlur(((shine - 80) * across).astype(np.float32), (0, 0), blur_px)
    closeup = strip(point, u_px)
    shaft_blur_px = seen_blur_px(4.0, -80.0, blur_px)
    seen = refine_tip(closeup, Reach("inside", 122.0, 100.0), 122.0, blur_px=shaft_blur_px)
    assert seen is not None
    assert seen.tip_px == pytest.approx(120.3, abs=0.7)


def cone(taper_px, grey, share=1.0):
    """A point in focus that gets thin, 7 px to 0.8 px at 120.3, and dim, to a share in the last 12 px."""
    u_px = np.arange(80, 160, dtype=np.float32)
    grey = grey * (1 - (1 - share) * np.clip((u_px - 108.3) / 12, 0, 1))
    half_px = np.clip(0.4 + 3.1 * (120.3 - u_px) / taper_px, 0.4, 3.5)
    covered = np.clip(half_px + 0.5 - abs(LANES), 0, 1) * np.clip(120.8 - u_px, 0, 1)
    return cv2.GaussianBlur((grey * covered).astype(np.float32), (0, 0), 0.8), u_px


@pytest.mark.parametrize("taper_px", [30, 50, 80])
@pytest.mark.parametrize("grey", [-80.0, 80.0])
@pytest.mark.parametrize("share", [0.3, 0.5, 1.0])
def test_a_point_that_gets_thin_and_dim_is_followed_to_its_end(taper_px, grey, share):
    point, u_px = cone(taper_px, grey, share)
    seen = refine_tip(strip(point, u_px), Reach("inside", 118.0, 100.0), 118.0)
    assert seen.tip_px == pytest.approx(120.3, abs=1.4)


@pytest.mark.parametrize("beyond_grey", [-30.0, -90.0])
def test_a_shaft_goes_on_where_its_contrast_changes_as_long_as_it_is_sharp(beyond_grey):
    shaft = needle(3.0, 100.0) + needle(3.0, 200.0, beyond_grey) * (U_PX > 100)
    assert goes_on(strip(shaft), 100.0, 200.0)


def test_a_shaft_does_not_go_on_in_its_shadow_nor_beyond_free_ground():
    shadow = -40.0 * SHADOW * ((U_PX > 100) & (U_PX <= 200))
    bubble = needle(3.0, 200.0) * (U_PX > 140)
    for beyond in (shadow, bubble):
        assert not goes_on(strip(needle(3.0, 100.0) + beyond), 100.0, 200.0)
    assert not goes_on(strip(needle(3.0, 100.0)), 100.0, 104.0)


@pytest.mark.parametrize("grey", [-80.0, 80.0])
def test_a_blunt_end_does_not_move_when_it_goes_out_of_focus(grey):
    u_px = np.arange(80, 160, dtype=np.float32)
    end = np.clip(3.5 - abs(LANES), 0, 1) * np.clip(120.8 - u_px, 0, 1) * grey
    places_px = []
    for blur_px in (0.8, 1.6, 2.4):
        blurred = cv2.GaussianBlur(end.astype(np.float32), (0, 0), blur_px)
        shaft_blur_px = seen_blur_px(3.0, grey, blur_px)
        seen = refine_tip(strip(blurred, u_px), Reach("inside", 122.0, 100.0), 122.0, blur_px=shaft_blur_px)
        assert seen is not None
        places_px.append(seen.tip_px)
    assert max(places_px) - min(places_px) < 0.3


@pytest.mark.parametrize(("gap", "where"), [(0, "inside"), (2, "outside")])
def test_a_needle_before_known_ground_that_shows_nothing_does_not_enter_the_wall(gap, where):
    u_px = np.arange(-240, 100, STATION_PX, dtype=np.float32)
    seen = strip(np.zeros((len(LANES), len(u_px))), u_px)
    end, rim = seen.before.stop - gap, seen.inside.start
    for part in (slice(0, end), slice(rim, rim + 2)):  # at the rim it looks like a tip when the light changes
        seen.excess[:, part] += 30.0 * (abs(LANES) <= 4)
    reach = find_reach(seen, px_per_mm=20.0, usual_grey=None)
    assert reach is not None
    assert reach.where == where


def test_edges_before_ground_nearly_as_bright_as_the_needle_reach_to_its_tip():
    u_px = np.arange(-240, 100, STATION_PX, dtype=np.float32)
    seen = strip(np.where(u_px < 0, 100.0, 20.0 * (u_px < 80)) * (abs(LANES) <= 4), u_px)
    fit = fit_line(seen, tip_px=80.0, miss_px=5.0)
    assert fit is not None
    assert fit.end_px(float(u_px[seen.inside.start])) == pytest.approx(80, abs=7)
