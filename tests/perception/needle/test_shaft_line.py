import math

import cv2
import numpy as np
import pytest
from drawn_strip import END_PX, LANES, U_PX, blurred, needle, seen_blur_px, strip_of
from drawn_strip import strip as drawn_strip
from msgspec.structs import replace

from haptigraph.config import PerceptionConfig
from haptigraph.geometry import ImageGeometry
from haptigraph.messages import Capture
from haptigraph.perception.needle.coarse_tip import estimate_coarse_tip
from haptigraph.perception.needle.rectify import STATION_PX, UNOBSERVED, Line, Site, rectify, stations
from haptigraph.perception.needle.search import PolarSearch
from haptigraph.perception.needle.shaft_line import Appearance, fit_line
from haptigraph.perception.needle.subpixel_tip import refine_tip, tip_patch_px
from haptigraph.perception.needle.tracker import BESIDE_MM, Tracker
from haptigraph.registration.camera import Registration
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.eye.eye import Eye, EyeShape, registration_text

GROUND, METAL = 150, 70


def draw(site: Site, line: Line, depth_px: float, *, metal: int = METAL, noise: float = 1.0) -> np.ndarray:
    """A plain needle of 0.5 mm on plain ground, sixteen times too large and then reduced; no wall."""
    finer = 4
    image = np.full((site.height_px * finer, site.width_px * finer), GROUND, np.uint8)
    start, end = (line.at_px(site.trocar_px, along) for along in (-300.0, depth_px))
    ends = [tuple(round(16 * (finer * value + (finer - 1) / 2)) for value in place) for place in (start, end)]
    half_px = 0.25 * site.px_per_mm * finer
    nx, ny = (16 * half_px * value for value in line.normal)
    corners = [
        (x + s * nx, y + s * ny) for (x, y), s in ((ends[0], -1), (ends[1], -1), (ends[1], 1), (ends[0], 1))
    ]
    cv2.fillConvexPoly(image, np.rint(corners).astype(np.int32), metal, lineType=cv2.LINE_AA, shift=4)
    small = cv2.resize(image, (site.width_px, site.height_px), interpolation=cv2.INTER_AREA).astype(
        np.float32
    )
    soft = cv2.GaussianBlur(small, (0, 0), 0.7)
    return np.clip(soft + np.random.default_rng(1).normal(0, noise, soft.shape), 0, 255).astype(np.uint8)


@pytest.fixture
def unknown(site) -> np.ndarray:
    return np.full((site.height_px, site.width_px), UNOBSERVED, np.float32)


@pytest.mark.parametrize("metal", [METAL, 230])
@pytest.mark.parametrize("turn_deg", [-1.5, 0.0, 2.0])
def test_line_and_tip_of_a_plain_needle_are_found_sub_pixel(site, unknown, metal, turn_deg):
    true = Line(site.inwards_rad + 0.1, 0.4)
    image = draw(site, true, 100.0, metal=metal)
    expected = Line(true.angle_rad - math.radians(turn_deg) / 2, 0.0)
    strip = strip_of(site, image, unknown, expected)
    reach = estimate_coarse_tip(strip, site.px_per_mm, None)
    fit = fit_line(strip, reach.tip_px, strip.half_px)
    assert expected.angle_rad + math.atan(fit.slope) == pytest.approx(true.angle_rad, abs=math.radians(0.2))
    assert expected.offset_px + fit.offset_px == pytest.approx(true.offset_px, abs=0.3)
    assert fit.confidence > 0.8
    found = Line(expected.angle_rad + math.atan(fit.slope), expected.offset_px + fit.offset_px)
    about_px = min(fit.end_px(0.0), reach.tip_px)
    (near,) = rectify(site, image, unknown, found, tip_patch_px(about_px))
    tip = refine_tip(near, reach, about_px)
    assert (tip.where, tip.tip_px) == ("inside", pytest.approx(100.0, abs=1.0))


@pytest.mark.parametrize("aside_px", [-2.4, 0.0, 1.7])
def test_a_tip_is_found_beside_the_middle_of_a_close_up(site, unknown, aside_px):
    true = Line(site.inwards_rad + 0.1, aside_px)
    image = draw(site, true, 100.0)
    wide, near = rectify(
        site, image, unknown, Line(true.angle_rad, 0.0), stations(site, true), tip_patch_px(98.0, 6)
    )
    reach = estimate_coarse_tip(wide, site.px_per_mm, None)
    tip = refine_tip(near, reach, 98.0, aside_px)
    assert (tip.where, tip.tip_px) == ("inside", pytest.approx(100.0, abs=1.0))


def test_a_tip_is_seen_up_to_the_far_wall(site, unknown):
    true = Line(site.inwards_rad + 0.1, 0.0)
    far_px = site.wall_px(true)[2]
    for beyond_px in (-3.0, -1.0, 0.0):
        image = draw(site, true, far_px + beyond_px)
        wide, near = rectify(site, image, unknown, true, stations(site, true), tip_patch_px(far_px))
        tip = refine_tip(near, estimate_coarse_tip(wide, site.px_per_mm, None), far_px)
        assert tip.tip_px == pytest.approx(far_px + beyond_px, abs=0.8)


@pytest.mark.parametrize("side", [-1, 1])
def test_a_bubble_beside_the_tip_does_not_make_it_longer(site, side):
    true = Line(site.inwards_rad + 0.1, 0.0)
    empty = draw(site, true, -900.0)
    image = draw(site, true, 100.0)
    nx, ny = true.normal
    x, y = true.at_px(site.trocar_px, 108.0)
    aside_px = side * (site.half_px + 2)
    cv2.circle(image, (round(x + aside_px * nx), round(y + aside_px * ny)), 7, 255, cv2.FILLED)
    strip, near = rectify(
        site, image, empty.astype(np.float32), true, stations(site, true), tip_patch_px(100.0)
    )
    reach = estimate_coarse_tip(strip, site.px_per_mm, None)
    assert reach.tip_px == pytest.approx(100.0, abs=2 * STATION_PX)
    assert refine_tip(near, reach, 100.0).tip_px == pytest.approx(100.0, abs=1.0)


def test_plain_ground_shows_no_needle(site, unknown):
    image = draw(site, Line(site.inwards_rad, 0.0), -900.0)
    strip = strip_of(site, image, unknown, Line(site.inwards_rad, 0.0))
    assert estimate_coarse_tip(strip, site.px_per_mm, None) is None
    assert fit_line(strip, 150.0, strip.half_px) is None
    assert PolarSearch(site).search(image) == []


@pytest.mark.parametrize("turn_deg", [-30.0, -4.0, 11.0, 35.0])
def test_the_fan_finds_the_angle_of_a_needle(site, turn_deg):
    true = Line(site.inwards_rad + math.radians(turn_deg), 0.0)
    found = PolarSearch(site).search(draw(site, true, 90.0))
    assert math.degrees(found[0].angle_rad - true.angle_rad) == pytest.approx(0, abs=1.5)


def test_the_fan_takes_colour_as_grey_and_no_other_size(site):
    image = draw(site, Line(site.inwards_rad + 0.1, 0.0), 90.0)
    fan = PolarSearch(site)
    found = fan.search(image)
    assert fan.search(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)) == found != []
    with pytest.raises(ValueError, match="expected an image of"):
        fan.search(image[:, :-1])


def test_the_fan_sees_what_is_bluer_within_the_globe_alone(site):
    drawn = draw(site, Line(site.inwards_rad + 0.1, 0.0), 90.0).astype(int)
    bluer = (GROUND - drawn) // 4
    image = np.dstack([GROUND + bluer, np.full_like(drawn, GROUND), GROUND - bluer]).clip(0, 255)
    image = image.astype(np.uint8)
    assert PolarSearch(site).search(image) == []
    assert PolarSearch(site).search(image, chroma_share=0.4)[0].angle_rad == pytest.approx(
        site.inwards_rad + 0.1, abs=math.radians(1)
    )


@pytest.fixture
def large() -> Registration:
    """An eye with room for a shaft before it."""
    geometry = ImageGeometry(center_px=(400.0, 420.0), mm_per_px=1 / 16, mirrored=True)
    return parse_registration(registration_text(Eye(EyeShape()), geometry, 800, 640), "large.toml")


@pytest.mark.parametrize("turn_deg", [-25.0, 0.0, 18.0])
@pytest.mark.parametrize("beside_mm", [-1.1, -0.5, 0.8])
def test_the_fan_finds_a_needle_that_points_beside_its_trocar(large, turn_deg, beside_mm):
    site = Site(large)
    true = Line(site.inwards_rad + math.radians(turn_deg), beside_mm * site.px_per_mm)
    fan = PolarSearch(site, BESIDE_MM, until_mm=0.0)
    found = fan.search(draw(site, true, -3.5 * site.px_per_mm))[0]
    assert math.degrees(found.angle_rad - true.angle_rad) == pytest.approx(0, abs=3)
    assert found.offset_px == pytest.approx(true.offset_px, abs=0.5 * site.px_per_mm)


@pytest.mark.parametrize("beside_mm", [-1.1, 0.8])
def test_a_needle_that_points_beside_its_trocar_is_seen_in_the_first_image(large, beside_mm):
    site = Site(large)
    true = Line(site.inwards_rad + 0.1, beside_mm * site.px_per_mm)
    depth_px = -3.5 * site.px_per_mm
    observation = Tracker(large, PerceptionConfig())(Capture(0, 0, draw(site, true, depth_px)))
    tip_px = large.image.to_px(observation.found["needle_tip"].at_mm)
    assert math.dist(tip_px, true.at_px(site.trocar_px, depth_px)) < 1.0


def test_what_was_always_there_is_no_needle(site):
    line = Line(site.inwards_rad, 0.0)
    stain = draw(site, line, 100.0)
    strip = strip_of(site, stain, stain.astype(np.float32), line)
    assert strip.is_known.all()
    assert estimate_coarse_tip(strip, site.px_per_mm, None) is None


def test_a_brighter_light_is_no_needle(site):
    ground = draw(site, Line(site.inwards_rad, 0.0), -900.0)
    brighter = np.clip(ground * 1.3, 0, 255).astype(np.uint8)
    strip = strip_of(site, brighter, ground.astype(np.float32), Line(site.inwards_rad, 0.0))
    assert np.abs(strip.excess).mean() < 3


def test_a_line_that_misses_the_globe_has_no_strip(site, unknown):
    image = draw(site, Line(site.inwards_rad, 0.0), -900.0)
    aside = Line(site.inwards_rad + math.pi / 2, 0.0)
    assert stations(site, aside) is None
    assert rectify(site, image, unknown, aside, tip_patch_px(50.0)) is None


def shaded_shaft(side, shade_grey):
    half_px = np.clip((END_PX + 60 - U_PX) / 20, 0.0, 5.0)
    lit = np.clip(half_px + 0.5 - abs(LANES), 0, 1)
    shone = np.clip(half_px * 0.4 + 0.5 - abs(side * LANES - half_px * 0.5), 0, 1)
    return drawn_strip(cv2.GaussianBlur(shade_grey * lit + (130 - shade_grey) * shone, (0, 0), 0.8))


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("shade_grey", [40.0, 60.0])
def test_the_axis_of_a_shaft_is_between_its_outer_edges_though_one_side_is_in_the_shade(side, shade_grey):
    seen = shaded_shaft(side, shade_grey)
    fit = fit_line(seen, END_PX, seen.half_px)
    assert fit.width_px == pytest.approx(10, abs=2)
    assert fit.offset_px == pytest.approx(0, abs=0.5)
    assert fit.offset_px + fit.slope * END_PX == pytest.approx(0, abs=0.5)


def matt_shaft(side, aside_deg, radius_px=5.0, grey=120.0):
    """A bright cylinder on black ground that scatters light from so far aside of the camera (Lambert)."""
    fine_px = (np.arange(10 * len(LANES)) + 0.5) / 10 - len(LANES) / 2
    surface_rad = np.arcsin(np.clip(side * fine_px / radius_px, -1, 1))
    light = np.cos(surface_rad + math.radians(aside_deg)).clip(0) * (abs(fine_px) < radius_px)
    lanes = light.reshape(-1, 10).mean(axis=1)[:, None]
    return drawn_strip(blurred(grey * lanes * (U_PX <= END_PX), 0.8, STATION_PX))


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize(("aside_deg", "off_px"), [(0, 0.05), (20, 0.5), (30, 0.8)])
def test_the_axis_is_nearer_to_the_edge_that_fades_into_the_shade(side, aside_deg, off_px):
    seen = matt_shaft(side, aside_deg)
    fit = fit_line(seen, END_PX, seen.half_px)
    assert abs(fit.offset_px) < off_px
    assert abs(fit.offset_px + fit.slope * END_PX) < off_px


def test_which_edge_fades_is_told_from_many_images():
    seen = matt_shaft(1, 30)
    _, at_first_px = fit_line(seen, END_PX, seen.half_px).look.shaded_px
    _, then_px = fit_line(seen, END_PX, seen.half_px, Appearance(shaded_px=(None, 0.0))).look.shaded_px
    assert at_first_px < -0.2
    assert then_px == pytest.approx(0.1 * at_first_px)


def test_a_side_that_is_not_seen_keeps_what_was_told_of_its_shade():
    seen = matt_shaft(1, 30)
    inside = replace(seen, before=slice(0, 0))
    assert fit_line(inside, END_PX, seen.half_px, Appearance(shaded_px=(0.3, 0.0))).look.shaded_px[0] == 0.3


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("grey", [-80.0, 80.0])
def test_a_bubble_that_touches_a_shaft_does_not_turn_its_line(side, grey):
    is_bubble = (abs(U_PX - END_PX + 30) <= 6) & (LANES * side > 0) & (LANES * side <= 12)
    picture = grey * ((abs(LANES) <= 3) & (U_PX <= END_PX) | is_bubble)
    seen = drawn_strip(blurred(picture, 0.8, STATION_PX))
    fit = fit_line(seen, END_PX, seen.half_px)
    assert fit.offset_px == pytest.approx(0, abs=0.2)
    assert fit.offset_px + fit.slope * END_PX == pytest.approx(0, abs=0.3)


@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize("from_px", [90, 110])
@pytest.mark.parametrize("grey", [-40.0, 40.0])
def test_a_vessel_along_a_shaft_is_not_taken_for_it(side, from_px, grey):
    is_vessel = (abs(U_PX - from_px - 14) <= 14) & (LANES * side > 0) & (LANES * side <= 12)
    picture = grey * ((abs(LANES) <= 3) & (U_PX <= END_PX) | is_vessel)
    seen = drawn_strip(blurred(picture, 0.8, STATION_PX))
    fit = fit_line(seen, END_PX, seen.half_px)
    assert fit.offset_px == pytest.approx(0, abs=0.4)
    assert fit.offset_px + fit.slope * END_PX == pytest.approx(0, abs=0.3)
    assert fit.confidence > 0.6


@pytest.mark.parametrize(("images", "width_px"), [(0, 10), (7, 10), (9, 5), (15, 5), (16, 10)])
def test_feet_are_tried_in_the_first_images_and_seldom_once_they_were_no_better(images, width_px):
    seen = shaded_shaft(1, 40.0)
    fit = fit_line(seen, END_PX, seen.half_px, Appearance(images=images))
    assert fit.width_px == pytest.approx(width_px, abs=2)
    assert fit.look.images == (0 if width_px == 10 else images + 1)


@pytest.mark.parametrize("half_width_px", [3.0, 5.0])
@pytest.mark.parametrize("grey", [-80.0, 80.0])
def test_the_blur_across_a_shaft_is_told(half_width_px, grey):
    for blur_px in (0.8, 1.2, 1.6):
        assert seen_blur_px(blurred(needle(half_width_px, grey=grey), blur_px, STATION_PX)) == pytest.approx(
            blur_px, abs=0.25
        )


@pytest.mark.parametrize("grey", [-25.0, 25.0])
def test_noise_does_not_make_edges_look_sharper(grey):
    assert seen_blur_px(blurred(needle(5.0, grey=grey), 1.6, STATION_PX)) == pytest.approx(1.6, abs=0.1)


@pytest.mark.parametrize("grey", [-28.0, 28.0])
def test_a_shaft_whose_edges_drown_in_noise_block_by_block_is_found_all_the_same(grey):
    u_px = np.arange(-240, 100, STATION_PX, dtype=np.float32)
    across = np.clip(3.5 - abs(LANES - 2), 0, 1)
    picture = blurred(grey * across * (u_px <= 80), 0.8, STATION_PX)
    noise = np.random.default_rng(3).normal(0, 7, picture.shape)
    seen = replace(drawn_strip(picture + noise, u_px), noise_grey=7.3)
    fit = fit_line(seen, tip_px=80.0, miss_px=5.0)
    assert fit.confidence > 0.6
    for along_px in (-200.0, 80.0):
        assert fit.offset_px + fit.slope * along_px == pytest.approx(2, abs=0.5)


def test_edges_before_ground_nearly_as_bright_as_the_needle_reach_to_its_tip():
    u_px = np.arange(-240, 100, STATION_PX, dtype=np.float32)
    seen = drawn_strip(np.where(u_px < 0, 100.0, 20.0 * (u_px < 80)) * (abs(LANES) <= 4), u_px)
    fit = fit_line(seen, tip_px=80.0, miss_px=5.0)
    assert fit is not None
    assert fit.end_px(float(u_px[seen.inside.start])) == pytest.approx(80, abs=7)
