"""The finder against the simulator's truth, on scenes of this file only."""

import math

import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from paths import RENDERINGS

from haptigraph.analysis.registering.registering import all_images
from haptigraph.errors import BadInput
from haptigraph.geometry import Circle, Polyline, distance_to_polyline
from haptigraph.messages import Image
from haptigraph.perception.anatomy.anatomy import find_anatomy
from haptigraph.perception.anatomy.rcm import Rcm
from haptigraph.perception.anatomy.rim import find_rim
from haptigraph.registration.camera import Registration, load_registration, parse_registration
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario

SCENES = [
    ("light", (331.0, 190.0), 9.0, 5),
    ("dark", (300.0, 205.0), 10.5, 12),
]


def play(style: str, center_px: tuple[float, float], px_per_mm: float, seed: int, images: int = 30):
    """A scenario through another camera: its images, spread out, and the truth."""
    scenario = load_scenario("wrong_place_then_hit")
    phantom = Phantom(
        replace(
            scenario,
            about=replace(scenario.about, seed=seed, rate_hz=1.5),
            camera=replace(
                scenario.camera,
                width_px=640,
                height_px=360,
                center_px=center_px,
                px_per_mm=px_per_mm,
                blur_px=0.6,
            ),
            appearance=replace(scenario.appearance, style=style),
        )
    )
    pictures = []
    while (moment := phantom.advance()) is not None:
        pictures.append(moment.image)
    return pictures[:: max(1, len(pictures) // images)], parse_registration(phantom.registration, "truth")


def still_scene(style: str = "light", px_per_mm: float = 10.0) -> Image:
    scenario = load_scenario("align_then_approach")
    camera = replace(
        scenario.camera,
        width_px=640,
        height_px=360,
        center_px=(320.0, 200.0),
        px_per_mm=px_per_mm,
        blur_px=0.6,
    )
    phantom = Phantom(replace(scenario, camera=camera, appearance=replace(scenario.appearance, style=style)))
    moment = phantom.advance()
    assert moment is not None
    return moment.image


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene[0])
def test_everything_is_found_on_simulated_scenes(scene):
    images, truth = play(*scene)
    found = find_anatomy(images)
    assert math.dist(found.center_px, truth.image.center_px) < 1.0
    assert found.radius_px == pytest.approx(truth.globe.radius_mm / truth.image.mm_per_px, abs=1.0)
    assert furthest_px(found.contour_px, truth) < 1.5
    assert found.refined > 80
    used = found.trocars[0]
    assert used.rcm is not None
    assert math.dist(used.point_px, truth.image.to_px(truth.trocar.at_mm)) < 1.5
    assert [trocar.rcm for trocar in found.trocars[1:]] == [None]


def furthest_px(contour_px: tuple[tuple[float, float], ...], truth: Registration) -> float:
    # The truth ends where the contour does; lengthened, ends compare across the retina, not along it.
    circle = Circle((0.0, 0.0), truth.globe.radius_mm)
    whole = Polyline(
        tuple(
            (circle.radius_mm * math.sin(math.radians(a)), -circle.radius_mm * math.cos(math.radians(a)))
            for a in range(-90, 91)
        )
    )
    return max(distance_to_polyline(truth.image.to_mm(p), whole) for p in contour_px) / truth.image.mm_per_px


def test_a_single_image_gives_globe_and_holes():
    found = find_anatomy([still_scene("dark")])
    assert math.dist(found.center_px, (320, 200)) < 1.0
    assert found.radius_px == pytest.approx(120, abs=1.0)
    assert all(trocar.rcm is None for trocar in found.trocars)
    assert sorted(round(trocar.angle_deg) for trocar in found.trocars) == pytest.approx([-36, 36], abs=1)


@pytest.mark.parametrize("step_px", [6, 18])
def test_a_rod_that_passes_sideways_is_no_needle_that_pivots(step_px):
    images = [still_scene() for _ in range(6)]
    for number, image in enumerate(images):
        x = 290 + step_px * number
        cv2.line(image, (x, 60), (x, 260), (30, 30, 30), 7, cv2.LINE_AA)
    found = find_anatomy(images)
    assert {trocar.rcm for trocar in found.trocars} == {None}


@pytest.mark.parametrize("name", ["black_round", "dark_bowl_long", "orange_bowl", "second_instrument"])
def test_a_rendered_needle_pivots_where_it_does_among_vessels_and_highlights(name):
    folder = RENDERINGS / name
    truth = load_registration(folder / "registration.toml")
    found = find_anatomy(list(all_images(str(folder / "clip.mp4"))))
    rcm = found.trocars[0].rcm
    assert rcm is not None
    assert math.dist(rcm.point_px, truth.image.to_px(truth.trocar.at_mm)) < 0.8
    assert found.radius_px == pytest.approx(truth.globe.radius_mm / truth.image.mm_per_px, abs=0.6)


def test_of_two_measurements_of_a_pivot_the_surer_counts_more():
    sure, vague = Rcm((100.0, 50.0), 9, 0.1, 0.5), Rcm((105.0, 40.0), 8, 0.4, 2.0)
    for both in (vague.and_again(sure), sure.and_again(vague)):
        assert both.point_px == pytest.approx((100 + 5 / 17, 50 - 10 / 17))
        assert (both.lines, both.radial_sd_px) == (9, 0.5)
    assert sure.and_again(None) is sure


def test_a_rim_before_the_section_is_told_by_the_pivot():
    """A wall seen 2 % larger than the section, as if it stood before the plane the needle moves in."""
    images, truth = play("dark", (319.5, 205.0), 10.0, 3)
    larger = cv2.getRotationMatrix2D((319.5, 179.5), 0, 1.02)
    y, x = np.mgrid[:360, :640]
    near_wall = np.abs(np.hypot(x - 319.5, y - 205.5) - 131) < 14
    moved = [
        np.where(near_wall[..., None], cv2.warpAffine(image, larger, (640, 360)), image) for image in images
    ]
    found = find_anatomy(moved)
    assert 1.01 < found.rim_ratio < 1.03
    assert found.radius_px == pytest.approx(truth.globe.radius_mm / truth.image.mm_per_px, abs=1.5)


def test_a_slanted_view_is_measured():
    scene = still_scene("dark")
    flat = cv2.warpAffine(
        scene, np.array([[1, 0, 0], [0, 0.97, 5.4]]), (640, 360), borderMode=cv2.BORDER_REPLICATE
    )
    rim = find_rim(flat)
    assert rim.inner.out_of_round_px == pytest.approx(1.8, abs=0.4)
    assert rim.outer is not None


def no_eye() -> Image:
    rng = np.random.default_rng(4)
    grain = cv2.resize(rng.normal(120, 30, (90, 16)).astype(np.float32), (640, 360))
    return np.repeat(np.clip(grain, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


BAD = {
    "wood": (no_eye(), "no eye"),
    "black": (np.zeros((360, 640, 3), np.uint8), "it is dark, its brightest parts have 0 of 255"),
    "grey": (np.full((360, 640, 3), 90, np.uint8), "no edges"),
    "noise": (np.random.default_rng(1).integers(0, 255, (360, 640, 3), np.uint8), "no eye"),
    "cut off": (still_scene()[:, :400], "cut off.*right border"),
    "blurred": (cv2.GaussianBlur(still_scene(), (0, 0), 9), "blurred|no eye"),
    "one edge": (
        cv2.circle(np.full((360, 640, 3), 90, np.uint8), (320, 180), 120, (200, 200, 200), -1),
        "only one edge",
    ),
    "overexposed": (cv2.convertScaleAbs(still_scene(), alpha=1.9), "overexposed: [6-9][0-9]% of it is white"),
    "small": (cv2.resize(still_scene(), None, fx=0.4, fy=0.4, interpolation=cv2.INTER_AREA), "no eye|small"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_pictures_are_refused_with_the_reason(name):
    image, reason = BAD[name]
    with pytest.raises(BadInput, match=reason):
        find_anatomy([np.ascontiguousarray(image)])
