import math

import cv2
import numpy as np
import pytest
from drawn_strip import END_PX, LANES, METAL, U_PX, blurred, draw_needle, fitted_blur_px, needle, strip_of
from drawn_strip import strip as drawn_strip
from msgspec.structs import replace

from haptigraph.perception.needle.coarse_tip import estimate_coarse_tip
from haptigraph.perception.needle.rectify import STATION_PX, UNOBSERVED, Line, rectify, stations
from haptigraph.perception.needle.shaft_line import NEW, Appearance, LineFit, fit_line
from haptigraph.perception.needle.subpixel_tip import refine_tip, tip_patch_px


@pytest.fixture
def unknown(eye) -> np.ndarray:
    return np.full((eye.height_px, eye.width_px), UNOBSERVED, np.float32)


@pytest.mark.parametrize("metal", [METAL, 230])
@pytest.mark.parametrize("turn_deg", [-1.5, 0.0, 2.0])
def test_locates_line_and_tip_of_a_plain_needle_sub_pixel(eye, unknown, metal, turn_deg):
    true = Line(eye.inwards_rad + 0.1, 0.4)
    image = draw_needle(eye, true, 100.0, metal=metal)
    expected = Line(true.angle_rad - math.radians(turn_deg) / 2, 0.0)
    strip = strip_of(eye, image, unknown, expected)
    coarse = estimate_coarse_tip(strip, eye.px_per_mm, None)
    fit = fit_line(strip, coarse.u_px, strip.half_px)
    assert expected.angle_rad + math.atan(fit.slope) == pytest.approx(true.angle_rad, abs=math.radians(0.2))
    assert expected.offset_px + fit.offset_px == pytest.approx(true.offset_px, abs=0.3)
    assert fit.confidence > 0.8
    found = Line(expected.angle_rad + math.atan(fit.slope), expected.offset_px + fit.offset_px)
    about_px = min(fit.end_px(0.0), coarse.u_px)
    (patch,) = rectify(eye, image, unknown, found, tip_patch_px(about_px))
    tip = refine_tip(patch, coarse, about_px)
    assert (tip.where, tip.u_px) == ("inside", pytest.approx(100.0, abs=1.0))


@pytest.mark.parametrize("off_axis_px", [-2.4, 0.0, 1.7])
def test_locates_a_tip_off_the_middle_of_its_patch(eye, unknown, off_axis_px):
    true = Line(eye.inwards_rad + 0.1, off_axis_px)
    image = draw_needle(eye, true, 100.0)
    wide, patch = rectify(
        eye, image, unknown, Line(true.angle_rad, 0.0), stations(eye, true), tip_patch_px(98.0, 6)
    )
    coarse = estimate_coarse_tip(wide, eye.px_per_mm, None)
    tip = refine_tip(patch, coarse, 98.0, off_axis_px)
    assert (tip.where, tip.u_px) == ("inside", pytest.approx(100.0, abs=1.0))


def test_locates_a_tip_up_to_the_far_wall(eye, unknown):
    true = Line(eye.inwards_rad + 0.1, 0.0)
    far_px = eye.wall_px(true)[2]
    for beyond_px in (-3.0, -1.0, 0.0):
        image = draw_needle(eye, true, far_px + beyond_px)
        wide, patch = rectify(eye, image, unknown, true, stations(eye, true), tip_patch_px(far_px))
        tip = refine_tip(patch, estimate_coarse_tip(wide, eye.px_per_mm, None), far_px)
        assert tip.u_px == pytest.approx(far_px + beyond_px, abs=0.8)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_bubble_beside_the_tip_does_not_make_it_longer(eye, side):
    true = Line(eye.inwards_rad + 0.1, 0.0)
    background = draw_needle(eye, true, -900.0)
    image = draw_needle(eye, true, 100.0)
    nx, ny = true.normal
    x, y = true.at_px(eye.trocar_px, 108.0)
    off_axis_px = side * (eye.half_px + 2)
    cv2.circle(image, (round(x + off_axis_px * nx), round(y + off_axis_px * ny)), 7, 255, cv2.FILLED)
    strip, patch = rectify(
        eye, image, background.astype(np.float32), true, stations(eye, true), tip_patch_px(100.0)
    )
    coarse = estimate_coarse_tip(strip, eye.px_per_mm, None)
    assert coarse.u_px == pytest.approx(100.0, abs=2 * STATION_PX)
    assert refine_tip(patch, coarse, 100.0).u_px == pytest.approx(100.0, abs=1.0)


def test_a_plain_background_has_no_needle(eye, unknown):
    image = draw_needle(eye, Line(eye.inwards_rad, 0.0), -900.0)
    strip = strip_of(eye, image, unknown, Line(eye.inwards_rad, 0.0))
    assert estimate_coarse_tip(strip, eye.px_per_mm, None) is None
    assert fit_line(strip, 150.0, strip.half_px) is None


def test_a_stain_in_the_background_is_no_needle(eye):
    line = Line(eye.inwards_rad, 0.0)
    stain = draw_needle(eye, line, 100.0)
    strip = strip_of(eye, stain, stain.astype(np.float32), line)
    assert strip.is_known.all()
    assert estimate_coarse_tip(strip, eye.px_per_mm, None) is None


def test_a_brighter_light_is_no_needle(eye):
    ground = draw_needle(eye, Line(eye.inwards_rad, 0.0), -900.0)
    brighter = np.clip(ground * 1.3, 0, 255).astype(np.uint8)
    strip = strip_of(eye, brighter, ground.astype(np.float32), Line(eye.inwards_rad, 0.0))
    assert np.abs(strip.excess).mean() < 3


def test_a_line_that_misses_the_globe_has_no_strip(eye, unknown):
    image = draw_needle(eye, Line(eye.inwards_rad, 0.0), -900.0)
    missing = Line(eye.inwards_rad + math.pi / 2, 0.0)
    assert stations(eye, missing) is None
    assert rectify(eye, image, unknown, missing, tip_patch_px(50.0)) is None


def shaded_shaft(side, shade_grey):
    half_px = np.clip((END_PX + 60 - U_PX) / 20, 0.0, 5.0)
    lit = np.clip(half_px + 0.5 - abs(LANES), 0, 1)
    highlight = np.clip(half_px * 0.4 + 0.5 - abs(side * LANES - half_px * 0.5), 0, 1)
    return drawn_strip(cv2.GaussianBlur(shade_grey * lit + (130 - shade_grey) * highlight, (0, 0), 0.8))


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("shade_grey", [40.0, 60.0])
def test_the_axis_is_between_the_outer_edges_though_one_side_is_in_the_shade(side, shade_grey):
    strip = shaded_shaft(side, shade_grey)
    fit = fit_line(strip, END_PX, strip.half_px)
    assert fit.width_px == pytest.approx(10, abs=2)
    assert fit.offset_px == pytest.approx(0, abs=0.5)
    assert fit.offset_px + fit.slope * END_PX == pytest.approx(0, abs=0.5)


def matte_shaft(side, light_deg, radius_px=5.0, grey=120.0):
    """A bright cylinder on black ground that scatters light from so far beside the camera (Lambert)."""
    fine_px = (np.arange(10 * len(LANES)) + 0.5) / 10 - len(LANES) / 2
    surface_rad = np.arcsin(np.clip(side * fine_px / radius_px, -1, 1))
    light = np.cos(surface_rad + math.radians(light_deg)).clip(0) * (abs(fine_px) < radius_px)
    lanes = light.reshape(-1, 10).mean(axis=1)[:, None]
    return drawn_strip(blurred(grey * lanes * (U_PX <= END_PX), 0.8, STATION_PX))


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize(("light_deg", "off_px"), [(0, 0.05), (20, 0.5), (30, 0.8)])
def test_the_axis_is_nearer_to_the_edge_that_fades_into_the_shade(side, light_deg, off_px):
    strip = matte_shaft(side, light_deg)
    fit = fit_line(strip, END_PX, strip.half_px)
    assert abs(fit.offset_px) < off_px
    assert abs(fit.offset_px + fit.slope * END_PX) < off_px


def test_measures_the_shaded_edge_over_many_images():
    strip = matte_shaft(1, 30)
    _, at_first_px = fit_line(strip, END_PX, strip.half_px).appearance.shaded_px
    _, then_px = fit_line(
        strip, END_PX, strip.half_px, Appearance(shaded_px=(None, 0.0))
    ).appearance.shaded_px
    assert at_first_px < -0.2
    assert then_px == pytest.approx(0.1 * at_first_px)


def test_a_side_that_is_not_visible_keeps_its_shade():
    strip = matte_shaft(1, 30)
    inside = replace(strip, outside=slice(0, 0))
    fit = fit_line(inside, END_PX, strip.half_px, Appearance(shaded_px=(0.3, 0.0)))
    assert fit.appearance.shaded_px[0] == 0.3


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("grey", [-80.0, 80.0])
def test_a_bubble_that_touches_a_shaft_does_not_turn_its_line(side, grey):
    is_bubble = (abs(U_PX - END_PX + 30) <= 6) & (LANES * side > 0) & (LANES * side <= 12)
    picture = grey * ((abs(LANES) <= 3) & (U_PX <= END_PX) | is_bubble)
    strip = drawn_strip(blurred(picture, 0.8, STATION_PX))
    fit = fit_line(strip, END_PX, strip.half_px)
    assert fit.offset_px == pytest.approx(0, abs=0.2)
    assert fit.offset_px + fit.slope * END_PX == pytest.approx(0, abs=0.3)


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("from_px", [90, 110])
@pytest.mark.parametrize("grey", [-40.0, 40.0])
def test_does_not_fit_a_line_to_a_vessel_along_a_shaft(side, from_px, grey):
    is_vessel = (abs(U_PX - from_px - 14) <= 14) & (LANES * side > 0) & (LANES * side <= 12)
    picture = grey * ((abs(LANES) <= 3) & (U_PX <= END_PX) | is_vessel)
    strip = drawn_strip(blurred(picture, 0.8, STATION_PX))
    fit = fit_line(strip, END_PX, strip.half_px)
    assert fit.offset_px == pytest.approx(0, abs=0.4)
    assert fit.offset_px + fit.slope * END_PX == pytest.approx(0, abs=0.3)
    assert fit.confidence > 0.6


@pytest.mark.parametrize("end_px", [60.0, END_PX])
def test_light_on_one_side_of_the_wall_turns_the_line_as_far_as_stated(end_px):
    u_px = np.arange(-140, 200, STATION_PX, dtype=np.float32)
    slopes = []
    for shift_px in (0.0, 0.2):
        across = np.clip(5.5 - abs(LANES - shift_px * (u_px < 0)), 0, 1)
        strip = drawn_strip(blurred(-80 * across * (u_px <= end_px), 0.8, STATION_PX), u_px)
        fit = fit_line(strip, end_px, strip.half_px)
        slopes.append(fit.slope)
    assert slopes[0] - slopes[1] == pytest.approx(fit.light_rad / math.sqrt(2), rel=0.1)
    outside = replace(strip, inside=slice(strip.outside.stop, strip.outside.stop))
    assert fit_line(outside, end_px, strip.half_px).light_rad == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(("images", "width_px"), [(0, 10), (7, 10), (9, 5), (15, 5), (16, 10)])
def test_tries_feet_in_the_first_images_and_seldom_once_they_were_no_better(images, width_px):
    strip = shaded_shaft(1, 40.0)
    fit = fit_line(strip, END_PX, strip.half_px, Appearance(images=images))
    assert fit.width_px == pytest.approx(width_px, abs=2)
    assert fit.appearance.images == (0 if width_px == 10 else images + 1)


@pytest.mark.parametrize("half_width_px", [3.0, 5.0])
@pytest.mark.parametrize("grey", [-80.0, 80.0])
def test_measures_the_blur_across_a_shaft(half_width_px, grey):
    for blur_px in (0.8, 1.2, 1.6):
        assert fitted_blur_px(
            blurred(needle(half_width_px, grey=grey), blur_px, STATION_PX)
        ) == pytest.approx(blur_px, abs=0.25)


@pytest.mark.parametrize("grey", [-25.0, 25.0])
def test_noise_does_not_make_edges_look_sharper(grey):
    assert fitted_blur_px(blurred(needle(5.0, grey=grey), 1.6, STATION_PX)) == pytest.approx(1.6, abs=0.1)


@pytest.mark.parametrize("grey", [-28.0, 28.0])
def test_fits_a_shaft_whose_edges_are_lost_in_noise_block_by_block(grey):
    u_px = np.arange(-240, 100, STATION_PX, dtype=np.float32)
    across = np.clip(3.5 - abs(LANES - 2), 0, 1)
    picture = blurred(grey * across * (u_px <= 80), 0.8, STATION_PX)
    noise = np.random.default_rng(3).normal(0, 7, picture.shape)
    strip = replace(drawn_strip(picture + noise, u_px), noise_grey=7.3)
    fit = fit_line(strip, tip_px=80.0, miss_px=5.0)
    assert fit.confidence > 0.6
    for along_px in (-200.0, 80.0):
        assert fit.offset_px + fit.slope * along_px == pytest.approx(2, abs=0.5)


def test_edges_on_a_background_nearly_as_bright_as_the_needle_reach_its_tip():
    u_px = np.arange(-240, 100, STATION_PX, dtype=np.float32)
    strip = drawn_strip(np.where(u_px < 0, 100.0, 20.0 * (u_px < 80)) * (abs(LANES) <= 4), u_px)
    fit = fit_line(strip, tip_px=80.0, miss_px=5.0)
    assert fit is not None
    assert fit.end_px(float(u_px[strip.inside.start])) == pytest.approx(80, abs=7)


@pytest.mark.parametrize(
    ("before", "beyond", "leads"),
    [
        (b"\1\1\1", b"", True),
        (b"\1\1\0", b"", True),
        (b"\1\1\0", b"\0\0\0", False),
        (b"\1\1\0", b"\0\0\1", True),
        (b"\1\0\0", b"\1\1\0", False),
        (b"\0\0\0", b"\1\1\1", True),
    ],
)
def test_a_shaft_whose_edges_end_before_the_wall_does_not_lead_through_it(before, beyond, leads):
    u_px = 6.0 * np.arange(-len(before), len(beyond), dtype=np.float32)
    fit = LineFit(0.0, 0.0, (1.0, 0.0, 1.0), 0.0, 5.0, 0.7, 1.0, NEW, u_px, u_px < 0, before + beyond)
    assert fit.leads_through(0.0) is leads
