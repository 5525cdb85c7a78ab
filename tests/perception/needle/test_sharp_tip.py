import cv2
import numpy as np
import pytest
from drawn_strip import END_PX, LANES, SHADOW, U_PX, blurred, needle, strip

from haptigraph.perception.needle.coarse_tip import TipEstimate
from haptigraph.perception.needle.rectify import STATION_PX
from haptigraph.perception.needle.sharp_tip import dim_end_px, goes_on, is_plain_end, sharp_end
from haptigraph.perception.needle.subpixel_tip import refine_tip


@pytest.mark.parametrize("half_width_px", [1.5, 3.0, 8.0])
@pytest.mark.parametrize("shadow_grey", [-20.0, -50.0])
def test_a_shadow_that_goes_on_in_line_with_the_needle_is_cut_off(half_width_px, shadow_grey):
    shaded = np.minimum(needle(half_width_px), shadow_grey * SHADOW * (U_PX <= 220))
    shaded += needle(half_width_px, grey=-15.0)
    end = sharp_end(strip(shaded), TipEstimate("inside", 220.0, 200.0))
    assert end is not None
    assert end.tip_px == pytest.approx(END_PX, abs=4)


@pytest.mark.parametrize("edge_px", [1.6, 1.7, 1.8])
def test_a_shadow_is_cut_off_though_noise_alone_is_softer_than_its_edges(edge_px):
    shadow = blurred(needle(6.0, 220.0, -70.0), edge_px, STATION_PX)
    shaded = np.minimum(blurred(needle(4.0, grey=-200.0), 0.8, STATION_PX), shadow)
    end = sharp_end(strip(shaded), TipEstimate("inside", 216.0, 200.0))
    assert end is not None
    assert end.tip_px == pytest.approx(END_PX, abs=4)


@pytest.mark.parametrize("half_width_px", [1.5, 3.0, 8.0])
def test_a_needle_that_is_sharp_up_to_its_tip_keeps_it(half_width_px):
    assert sharp_end(strip(needle(half_width_px)), TipEstimate("inside", END_PX, 100.0)) is None


def test_a_shaft_of_which_nothing_is_sharp_keeps_its_tip():
    blurred = -30 * np.exp(-((LANES / 6) ** 2)) * (END_PX >= U_PX)
    assert sharp_end(strip(blurred), TipEstimate("inside", END_PX, 100.0)) is None


def test_a_needle_that_fades_in_the_noise_keeps_its_tip():
    fading = needle(1.5) * np.clip((END_PX - U_PX) / 100, 0, 1)
    assert sharp_end(strip(fading), TipEstimate("inside", END_PX, 100.0)) is None


@pytest.mark.parametrize("tip_px", [9.0, 12.0, 20.0])
def test_a_tip_right_behind_the_wall_is_left_alone(tip_px):
    assert sharp_end(strip(needle(3.0, tip_px)), TipEstimate("inside", tip_px, 10.0)) is None


@pytest.mark.parametrize("half_width_px", [2.0, 4.0])
@pytest.mark.parametrize("dim_px", [7, 12])
@pytest.mark.parametrize("grey", [-60.0, 60.0])
def test_a_point_that_gets_dim_before_its_end_is_followed_to_it(half_width_px, dim_px, grey):
    u_px = np.arange(100, 170, dtype=np.float32)
    across = np.clip(half_width_px + 0.5 - abs(LANES), 0, 1)
    lit = np.where(u_px <= END_PX - dim_px, 1, 0.45) * (u_px <= END_PX)
    seen = strip(cv2.GaussianBlur(grey * across * lit, (0, 0), 0.8), u_px)
    reach = TipEstimate("inside", END_PX - dim_px, 100.0, contrast_grey=60.0)
    end_px = dim_end_px(seen, reach)
    assert end_px == pytest.approx(END_PX, abs=1.5)
    end = refine_tip(seen, reach, end_px, behinds_px=(6,))
    assert end.tip_px == pytest.approx(END_PX, abs=1.2)


@pytest.mark.parametrize("shadow_grey", [-15.0, -30.0])
def test_a_shadow_is_no_dim_point(shadow_grey):
    u_px = np.arange(100, 170, dtype=np.float32)
    across = np.clip(3.5 - abs(LANES), 0, 1)
    shaded = np.minimum(-60 * across * (u_px <= END_PX), shadow_grey * SHADOW * (u_px <= END_PX + 10))
    reach = TipEstimate("inside", END_PX, 100.0, contrast_grey=60.0)
    assert dim_end_px(strip(shaded, u_px), reach) is None


def test_what_ends_where_its_contrast_falls_is_no_dim_point():
    reach = TipEstimate("inside", END_PX, 100.0, contrast_grey=40.0)
    assert dim_end_px(strip(needle(3.0)), reach) is None


@pytest.mark.parametrize("beyond_grey", [-30.0, -90.0])
@pytest.mark.parametrize("end_px", [114.0, 200.0])
def test_a_shaft_goes_on_where_its_contrast_changes_as_long_as_it_is_sharp(beyond_grey, end_px):
    shaft = needle(3.0, 100.0) + needle(3.0, end_px, beyond_grey) * (U_PX > 100)
    assert goes_on(strip(shaft), 100.0, end_px)


def test_a_shaft_goes_on_before_the_wall_as_well():
    seen = strip(needle(3.0, 0.0))
    assert goes_on(seen, float(U_PX[4]), float(U_PX[seen.before.stop]))
    assert not goes_on(strip(needle(3.0, float(U_PX[4]))), float(U_PX[4]), float(U_PX[seen.before.stop]))


def test_a_shaft_does_not_go_on_in_its_shadow_nor_beyond_free_ground():
    shadow = -40.0 * SHADOW * ((U_PX > 100) & (U_PX <= 200))
    bubble = needle(3.0, 200.0) * (U_PX > 140)
    for beyond in (shadow, bubble):
        assert not goes_on(strip(needle(3.0, 100.0) + beyond), 100.0, 200.0)
    assert not goes_on(strip(needle(3.0, 100.0)), 100.0, 104.0)


def shaft_before_its_shadow(shadow_grey, along=1.0):
    shadow = blurred(needle(4.0, 180.0, shadow_grey), 1.7, STATION_PX)
    return strip(np.minimum(blurred(along * needle(4.0, grey=-100.0), 1.7, STATION_PX), shadow))


@pytest.mark.parametrize(("shadow_grey", "is_end"), [(-15.0, True), (-30.0, True), (-50.0, False)])
def test_an_even_shaft_ends_where_only_its_shadow_goes_on_however_sharp(shadow_grey, is_end):
    fall = TipEstimate("inside", END_PX, 140.0)
    assert is_plain_end(shaft_before_its_shadow(shadow_grey), fall, 180.0) == is_end


def test_a_shaft_that_mirrors_its_surroundings_does_not_plainly_end_where_it_gets_dim():
    uneven = shaft_before_its_shadow(-15.0, along=0.7 + 0.3 * np.sin(U_PX / 8))
    assert not is_plain_end(uneven, TipEstimate("inside", END_PX, 140.0), 180.0)


def test_too_little_of_a_shaft_does_not_tell_whether_it_is_even():
    assert not is_plain_end(shaft_before_its_shadow(-15.0), TipEstimate("inside", 20.0, 20.0), 180.0)
