import numpy as np
import pytest
from drawn_strip import END_PX, LANES, SHADOW, U_PX, blurred, needle, strip

from haptigraph.perception.needle.coarse_tip import TipEstimate
from haptigraph.perception.needle.rectify import STATION_PX
from haptigraph.perception.needle.sharp_tip import continues, is_clear_end, sharp_end


@pytest.mark.parametrize("half_width_px", [1.5, 3.0, 8.0])
@pytest.mark.parametrize("shadow_grey", [-20.0, -50.0])
def test_a_shadow_that_continues_in_line_with_the_needle_is_cut_off(half_width_px, shadow_grey):
    shaded = np.minimum(needle(half_width_px), shadow_grey * SHADOW * (U_PX <= 220))
    shaded += needle(half_width_px, grey=-15.0)
    end = sharp_end(strip(shaded), TipEstimate("inside", 220.0, 200.0))
    assert end is not None
    assert end.u_px == pytest.approx(END_PX, abs=4)


@pytest.mark.parametrize("edge_px", [1.6, 1.7, 1.8])
def test_cuts_off_a_shadow_though_noise_alone_is_softer_than_its_edges(edge_px):
    shadow = blurred(needle(6.0, 220.0, -70.0), edge_px, STATION_PX)
    shaded = np.minimum(blurred(needle(4.0, grey=-200.0), 0.8, STATION_PX), shadow)
    end = sharp_end(strip(shaded), TipEstimate("inside", 216.0, 200.0))
    assert end is not None
    assert end.u_px == pytest.approx(END_PX, abs=4)


@pytest.mark.parametrize("half_width_px", [1.5, 3.0, 8.0])
def test_a_needle_that_is_sharp_up_to_its_tip_keeps_it(half_width_px):
    assert sharp_end(strip(needle(half_width_px)), TipEstimate("inside", END_PX, 100.0)) is None


def test_a_shaft_without_anything_sharp_keeps_its_tip():
    defocused = -30 * np.exp(-((LANES / 6) ** 2)) * (END_PX >= U_PX)
    assert sharp_end(strip(defocused), TipEstimate("inside", END_PX, 100.0)) is None


@pytest.mark.parametrize("beyond_px", [0.0, 1.0, 2.0, 3.0, 5.0])
def test_a_tip_right_beyond_the_strip_is_treated_as_at_its_end(beyond_px):
    end_px = float(U_PX[-1])
    shaded = np.minimum(needle(3.0), -50.0 * SHADOW) + needle(3.0, grey=-15.0)
    end = sharp_end(strip(shaded), TipEstimate("inside", end_px + beyond_px, 200.0))
    assert end is not None
    assert end.u_px == pytest.approx(END_PX, abs=4)


def test_a_needle_that_fades_in_the_noise_keeps_its_tip():
    fading = needle(1.5) * np.clip((END_PX - U_PX) / 100, 0, 1)
    assert sharp_end(strip(fading), TipEstimate("inside", END_PX, 100.0)) is None


@pytest.mark.parametrize("tip_px", [9.0, 12.0, 20.0])
def test_a_tip_right_behind_the_wall_is_left_alone(tip_px):
    assert sharp_end(strip(needle(3.0, tip_px)), TipEstimate("inside", tip_px, 10.0)) is None


def test_the_end_of_what_is_sharp_has_the_certainty_of_its_contrast():
    shaft = needle(4, grey=-60.0)
    shadow = -30.0 * np.exp(-((LANES / 9) ** 2)) * (U_PX <= END_PX + 80)
    drawn = strip(np.minimum(shaft, shadow))
    end = sharp_end(drawn, TipEstimate("inside", END_PX + 80, 100.0))
    assert end is not None and end.u_px == pytest.approx(END_PX, abs=3.0)
    assert end.contrast_grey == pytest.approx(60, abs=15)


@pytest.mark.parametrize("beyond_grey", [-30.0, -90.0])
@pytest.mark.parametrize("end_px", [114.0, 200.0])
def test_a_shaft_continues_where_its_contrast_changes_as_long_as_it_is_sharp(beyond_grey, end_px):
    shaft = needle(3.0, 100.0) + needle(3.0, end_px, beyond_grey) * (U_PX > 100)
    assert continues(strip(shaft), 100.0, end_px)


def test_a_shaft_continues_outside_the_wall_as_well():
    shaft = strip(needle(3.0, 0.0))
    assert continues(shaft, float(U_PX[4]), float(U_PX[shaft.outside.stop]))
    assert not continues(strip(needle(3.0, float(U_PX[4]))), float(U_PX[4]), float(U_PX[shaft.outside.stop]))


def test_a_shaft_does_not_continue_in_its_shadow_nor_beyond_a_free_background():
    shadow = -40.0 * SHADOW * ((U_PX > 100) & (U_PX <= 200))
    bubble = needle(3.0, 200.0) * (U_PX > 140)
    for beyond in (shadow, bubble):
        assert not continues(strip(needle(3.0, 100.0) + beyond), 100.0, 200.0)
    assert not continues(strip(needle(3.0, 100.0)), 100.0, 104.0)


def shaft_before_its_shadow(shadow_grey, along=1.0):
    shadow = blurred(needle(4.0, 180.0, shadow_grey), 1.7, STATION_PX)
    return strip(np.minimum(blurred(along * needle(4.0, grey=-100.0), 1.7, STATION_PX), shadow))


@pytest.mark.parametrize(("shadow_grey", "is_end"), [(-15.0, True), (-30.0, True), (-50.0, False)])
def test_an_even_shaft_ends_where_only_its_shadow_continues_however_sharp(shadow_grey, is_end):
    step = TipEstimate("inside", END_PX, 140.0)
    assert is_clear_end(shaft_before_its_shadow(shadow_grey), step, 180.0) == is_end


def test_a_shaft_that_mirrors_its_surroundings_has_no_clear_end_where_it_gets_dim():
    uneven = shaft_before_its_shadow(-15.0, along=0.7 + 0.3 * np.sin(U_PX / 8))
    assert not is_clear_end(uneven, TipEstimate("inside", END_PX, 140.0), 180.0)


def test_a_short_shaft_has_no_clear_end():
    assert not is_clear_end(shaft_before_its_shadow(-15.0), TipEstimate("inside", 20.0, 20.0), 180.0)
