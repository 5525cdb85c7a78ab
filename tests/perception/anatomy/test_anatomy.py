"""The anatomy found against the simulator's ground truth, on scenes of this file only."""

import math

import cv2
import numpy as np
import pytest
from helpers import mostly_slow
from msgspec.structs import replace
from paths import RENDERINGS

from haptigraph.analysis.registering.registering import all_images
from haptigraph.errors import BadInput
from haptigraph.geometry import Circle, Polyline, distance_to_polyline
from haptigraph.messages import Image
from haptigraph.perception.anatomy.anatomy import find_anatomy
from haptigraph.perception.anatomy.rcm import Rcm
from haptigraph.perception.anatomy.rim import find_rim
from haptigraph.registration.camera import Registration
from haptigraph.registration.loading import load_registration, parse_registration
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario

SCENES = [
    ("light", (331.0, 190.0), 9.0, 5),
    ("dark", (300.0, 205.0), 10.5, 12),
]


def play(style: str, center_px: tuple[float, float], px_per_mm: float, seed: int, images: int = 30):
    """A scenario with another camera: some of its images, and the true registration."""
    scenario = load_scenario("wrong_place_then_hit")
    phantom = Phantom(
        replace(
            scenario,
            about=replace(scenario.about, seed=seed, rate_hz=1.2),
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
    rendered = []
    while (moment := phantom.advance()) is not None:
        rendered.append(moment.image)
    return rendered[:: max(1, len(rendered) // images)], parse_registration(phantom.registration, "truth")


def scene_image(style: str = "light", px_per_mm: float = 10.0) -> Image:
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


@pytest.mark.parametrize("scene", mostly_slow(SCENES, SCENES[1]), ids=lambda scene: scene[0])
def test_the_anatomy_of_simulated_scenes_is_found(scene):
    images, truth = play(*scene)
    found = find_anatomy(images)
    assert math.dist(found.center_px, truth.image.center_px) < 1.0
    assert found.radius_px == pytest.approx(truth.globe.radius_mm / truth.image.mm_per_px, abs=1.0)
    assert furthest_px(found.contour_px, truth) < 1.5
    assert found.measured_points > 80
    used = found.trocars[0]
    assert used.rcm is not None
    assert math.dist(used.point_px, truth.image.to_px(truth.trocar.at_mm)) < 1.5
    assert [trocar.rcm for trocar in found.trocars[1:]] == [None]


def furthest_px(contour_px: tuple[tuple[float, float], ...], truth: Registration) -> float:
    # The true retina ends where the contour does; extend it, so that the ends compare across it, not along it.
    circle = Circle((0.0, 0.0), truth.globe.radius_mm)
    whole = Polyline(
        tuple(
            (circle.radius_mm * math.sin(math.radians(a)), -circle.radius_mm * math.cos(math.radians(a)))
            for a in range(-90, 91)
        )
    )
    return max(distance_to_polyline(truth.image.to_mm(p), whole) for p in contour_px) / truth.image.mm_per_px


def test_a_single_image_yields_globe_and_port_openings():
    found = find_anatomy([scene_image("dark")])
    assert math.dist(found.center_px, (320, 200)) < 1.0
    assert found.radius_px == pytest.approx(120, abs=1.0)
    assert all(trocar.rcm is None for trocar in found.trocars)
    assert sorted(round(trocar.angle_deg) for trocar in found.trocars) == pytest.approx([-36, 36], abs=1)


@pytest.mark.parametrize("step_px", mostly_slow([6, 18], 6))
def test_a_rod_that_moves_sideways_has_no_rcm(step_px):
    scene = scene_image()
    images = [scene.copy() for _ in range(6)]
    for number, image in enumerate(images):
        x = 290 + step_px * number
        cv2.line(image, (x, 60), (x, 260), (30, 30, 30), 7, cv2.LINE_AA)
    found = find_anatomy(images)
    assert {trocar.rcm for trocar in found.trocars} == {None}


@pytest.mark.parametrize(
    "name",
    [
        "second_instrument",
        *(
            pytest.param(each, marks=pytest.mark.slow)
            for each in ("black_round", "dark_bowl_long", "orange_bowl")
        ),
    ],
)
def test_the_rcm_of_a_rendered_needle_is_found_among_vessels_and_specular_highlights(name):
    folder = RENDERINGS / name
    truth = load_registration(folder / "registration.toml")
    found = find_anatomy(list(all_images(str(folder / "clip.mp4")))[::2])
    rcm = found.trocars[0].rcm
    assert rcm is not None
    assert math.dist(rcm.point_px, truth.image.to_px(truth.trocar.at_mm)) < 0.8
    assert found.radius_px == pytest.approx(truth.globe.radius_mm / truth.image.mm_per_px, abs=0.6)


def test_two_measurements_of_an_rcm_are_weighted_by_their_inverse_variance():
    certain, uncertain = Rcm((100.0, 50.0), 9, 0.1, 0.5), Rcm((105.0, 40.0), 8, 0.4, 2.0)
    for both in (uncertain.combined_with(certain), certain.combined_with(uncertain)):
        assert both.point_px == pytest.approx((100 + 5 / 17, 50 - 10 / 17))
        assert (both.lines, both.radial_sd_px) == (9, 0.5)
    assert certain.combined_with(None) is certain


def test_the_rcm_reveals_a_rim_in_front_of_the_section():
    """A wall that appears 2 % larger than the section, as if it were in front of the needle's plane."""
    images, truth = play("dark", (319.5, 205.0), 10.0, 3)
    larger = cv2.getRotationMatrix2D((319.5, 179.5), 0, 1.02)
    y, x = np.mgrid[:360, :640]
    near_wall = np.abs(np.hypot(x - 319.5, y - 205.5) - 131) < 14
    moved = [
        np.where(near_wall[..., None], cv2.warpAffine(image, larger, (640, 360)), image) for image in images
    ]
    found = find_anatomy(moved)
    assert 1.009 < found.rim_ratio < 1.03
    assert found.radius_px == pytest.approx(truth.globe.radius_mm / truth.image.mm_per_px, abs=1.5)


def test_the_many_rings_of_a_screw_do_not_distract_from_an_eye_that_is_not_quite_round():
    scenario = load_scenario("align_then_approach")
    camera = replace(scenario.camera, tilt_deg=(6.0, 2.0), center_px=(520.0, 340.0), distance_mm=60.0)
    moment = Phantom(replace(scenario, camera=camera)).advance()
    assert moment is not None
    image = moment.image.copy()
    eye = find_rim(image).inner
    for radius, grey in ((64, 60), (57, 200), (50, 40), (44, 150)):
        cv2.circle(image, (1180, 560), radius, (grey, grey, grey), -1, cv2.LINE_AA)

    found = find_rim(image).inner

    assert math.dist(found.center_px, eye.center_px) < 0.2
    assert found.radius_px == pytest.approx(eye.radius_px, abs=0.2)


def test_the_rim_of_a_tilted_view_is_found():
    scene = scene_image("dark")
    flat = cv2.warpAffine(
        scene, np.array([[1, 0, 0], [0, 0.97, 5.4]]), (640, 360), borderMode=cv2.BORDER_REPLICATE
    )
    rim = find_rim(flat)
    assert rim.inner.out_of_round_px == pytest.approx(1.8, abs=0.4)
    assert rim.outer is not None


@pytest.mark.parametrize("shift_px", [(0.0, 0.0), (1.3, 0.7)])
def test_both_edges_of_a_wall_are_found_that_is_far_from_round(shift_px):
    scenario = load_scenario("align_then_approach")
    camera = replace(scenario.camera, tilt_deg=(0.0, 18.0), center_px=(600.0, 370.0), distance_mm=60.0)
    moment = Phantom(replace(scenario, camera=camera)).advance()
    assert moment is not None
    shift = np.array([[1, 0, shift_px[0]], [0, 1, shift_px[1]]])
    rim = find_rim(cv2.warpAffine(moment.image, shift, (1280, 720), borderMode=cv2.BORDER_REPLICATE))
    assert rim.inner.out_of_round_px > 0.02 * rim.inner.radius_px
    assert rim.outer is not None
    wall_ratio = 1 + 2 * scenario.eye.wall_mm / scenario.eye.diameter_mm
    assert rim.outer.radius_px / rim.inner.radius_px == pytest.approx(wall_ratio, abs=0.005)


def no_eye() -> Image:
    rng = np.random.default_rng(4)
    grain = cv2.resize(rng.normal(120, 30, (90, 16)).astype(np.float32), (640, 360))
    return np.repeat(np.clip(grain, 0, 255).astype(np.uint8)[..., None], 3, axis=2)


BAD = {
    "wood": (no_eye(), "no eye"),
    "black": (np.zeros((360, 640, 3), np.uint8), "it is dark, its brightest parts have 0 of 255"),
    "grey": (np.full((360, 640, 3), 90, np.uint8), "no edges"),
    "noise": (np.random.default_rng(1).integers(0, 255, (360, 640, 3), np.uint8), "no eye"),
    "cut off": (scene_image()[:, :400], "cut off.*right border"),
    "blurred": (cv2.GaussianBlur(scene_image(), (0, 0), 9), "blurred|no eye"),
    "one edge": (
        cv2.circle(np.full((360, 640, 3), 90, np.uint8), (320, 180), 120, (200, 200, 200), -1),
        "only one edge",
    ),
    "overexposed": (cv2.convertScaleAbs(scene_image(), alpha=1.9), "overexposed: [6-9][0-9]% of it is white"),
    "small": (cv2.resize(scene_image(), None, fx=0.4, fy=0.4, interpolation=cv2.INTER_AREA), "no eye|small"),
}


@pytest.mark.parametrize("name", BAD)
def test_unsuitable_images_are_refused_with_the_reason(name):
    image, reason = BAD[name]
    with pytest.raises(BadInput, match=reason):
        find_anatomy([np.ascontiguousarray(image)])
