import numpy as np
import pytest
from drawn_strip import END_PX, LANES, SHADOW, U_PX, blurred, fitted_blur_px, needle, strip

from haptigraph.perception.needle.coarse_tip import TipEstimate
from haptigraph.perception.needle.rectify import STATION_PX
from haptigraph.perception.needle.subpixel_tip import refine_tip


def thin_point(u_px, end_px, highlight_grey):
    half_px = np.where(u_px <= end_px, 1.5 + (end_px - u_px) / 12, 0)
    across = np.clip(half_px + 0.5 - abs(LANES), 0, 1) * np.clip(end_px + 0.5 - u_px, 0, 1)
    highlight = highlight_grey * np.exp(-((LANES / np.maximum(half_px / 3, 0.5)) ** 2))
    return (highlight - 80) * across


@pytest.mark.parametrize("blur_px", [0.8, 1.5, 2.2])
@pytest.mark.parametrize("highlight_grey", [0.0, 140.0, 170.0, 300.0])
def test_locates_a_thin_point_with_any_highlight_on_its_middle(blur_px, highlight_grey):
    u_px = np.arange(80, 160, dtype=np.float32)
    patch = strip(blurred(thin_point(u_px, 120.3, highlight_grey), blur_px), u_px)
    shaft_blur_px = fitted_blur_px(blurred(thin_point(U_PX, END_PX, highlight_grey), blur_px, STATION_PX))
    found = refine_tip(patch, TipEstimate("inside", 122.0, 100.0), 122.0, blur_px=shaft_blur_px)
    assert found is not None
    assert found.u_px == pytest.approx(120.3, abs=0.6)


def cone(taper_px, grey, share=1.0):
    """A point in focus that gets thin, from 7 px to 0.8 px at 120.3, and dim, to a share in its last 12 px."""
    u_px = np.arange(80, 160, dtype=np.float32)
    grey = grey * (1 - (1 - share) * np.clip((u_px - 108.3) / 12, 0, 1))
    half_px = np.clip(0.4 + 3.1 * (120.3 - u_px) / taper_px, 0.4, 3.5)
    covered = np.clip(half_px + 0.5 - abs(LANES), 0, 1) * np.clip(120.8 - u_px, 0, 1)
    return blurred(grey * covered, 0.8), u_px


@pytest.mark.parametrize("taper_px", [30, 50, 80])
@pytest.mark.parametrize("grey", [-80.0, 80.0])
@pytest.mark.parametrize("share", [0.3, 0.5, 1.0])
def test_follows_a_point_that_gets_thin_and_dim_to_its_end(taper_px, grey, share):
    point, u_px = cone(taper_px, grey, share)
    found = refine_tip(strip(point, u_px), TipEstimate("inside", 118.0, 100.0), 118.0)
    assert found.u_px == pytest.approx(120.3, abs=1.4)


@pytest.mark.parametrize("grey", [-80.0, 80.0])
def test_a_blunt_end_does_not_move_when_it_goes_out_of_focus(grey):
    u_px = np.arange(80, 160, dtype=np.float32)
    end = np.clip(3.5 - abs(LANES), 0, 1) * np.clip(120.8 - u_px, 0, 1) * grey
    positions_px = []
    for blur_px in (0.8, 1.6, 2.4):
        shaft_blur_px = fitted_blur_px(blurred(needle(3.0, grey=grey), blur_px, STATION_PX))
        patch = strip(blurred(end, blur_px), u_px)
        found = refine_tip(patch, TipEstimate("inside", 122.0, 100.0), 122.0, blur_px=shaft_blur_px)
        assert found is not None
        positions_px.append(found.u_px)
    assert max(positions_px) - min(positions_px) < 0.3


def with_faint_end(grey, length_px, faint):
    """A point in focus, 3 px thick, and beyond it a faint part that ends at 120.3."""
    u_px = np.arange(80, 160, dtype=np.float32)
    shaft = np.clip(2.0 - abs(LANES), 0, 1) * np.clip(120.8 - length_px - u_px, 0, 1)
    return strip(blurred(grey * np.maximum(shaft, faint * np.clip(120.8 - u_px, 0, 1)), 0.8), u_px)


@pytest.mark.parametrize("grey", [-80.0, 80.0])
@pytest.mark.parametrize("length_px", [4.0, 5.0, 6.0])
def test_follows_the_faint_last_part_of_a_point_but_no_shadow_beyond_it(grey, length_px):
    tip = TipEstimate("inside", 118.0, 100.0)
    one_px_wide = 0.6 * np.clip(1.0 - abs(LANES), 0, 1)
    found = refine_tip(with_faint_end(grey, length_px, one_px_wide), tip, 118.0)
    assert found.u_px == pytest.approx(120.3, abs=1.0)
    for wide in (0.25 * SHADOW, 0.25 * np.exp(-((LANES / 2.5) ** 2))):
        found = refine_tip(with_faint_end(grey, length_px, wide), tip, 118.0)
        assert found.u_px == pytest.approx(120.3 - length_px, abs=1.3)


@pytest.mark.parametrize("grey", [-80.0, 80.0])
def test_an_object_beyond_a_gap_is_no_part_of_the_point(grey):
    u_px = np.arange(80, 160, dtype=np.float32)
    covered = np.clip(120.8 - u_px, 0, 1) + 0.25 * ((u_px > 123) & (u_px < 126))
    patch = strip(blurred(grey * np.clip(2.0 - abs(LANES), 0, 1) * covered, 0.8), u_px)
    found = refine_tip(patch, TipEstimate("inside", 120.0, 100.0), 120.0)
    assert found.u_px == pytest.approx(120.3, abs=0.6)
