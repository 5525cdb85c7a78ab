import cv2
import numpy as np
import pytest
from drawn_strip import draw_rim
from msgspec.structs import replace

from haptigraph.config import PerceptionConfig
from haptigraph.geometry import norm, subtract
from haptigraph.imaging import grey_of
from haptigraph.messages import Capture
from haptigraph.perception.needle.background import Background
from haptigraph.perception.needle.rectify import UNOBSERVED, EyeGeometry, Line, stations
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.projection import ImageGeometry
from haptigraph.registration.background import BackgroundImage
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.eye.eye import Eye, EyeShape, registration_text

GREY_GROUND, ORANGE_GROUND = (150, 150, 150), (69, 101, 148)
SHADED_METAL = 111  # as bright as that orange is
DEPTH_PX = 100.0


@pytest.fixture
def registration():
    geometry = ImageGeometry(center_px=(320.0, 240.0), mm_per_px=1 / 16, mirrored=True)
    return parse_registration(registration_text(Eye(EyeShape()), geometry, 640, 480), "an eye from close by")


@pytest.fixture
def eye(registration):
    return EyeGeometry(registration)


def draw_eye(
    eye: EyeGeometry, ground: tuple[int, int, int], depth_px: float | None = None, noise: float = 1.0
):
    """An eye of one colour on a dark table, with or without a needle as grey as metal in its shade."""
    image = np.full((eye.height_px, eye.width_px, 3), 50, np.uint8)
    center_px = tuple(round(value) for value in eye.center_px)
    cv2.circle(image, center_px, round(eye.outer_px), ground, -1)
    draw_rim(image, eye)
    if depth_px is not None:
        line = Line(eye.inwards_rad, 0.0)
        ends = (line.at_px(eye.trocar_px, along) for along in (-90.0, depth_px - 2.5))
        places = [tuple(round(16 * value) for value in end) for end in ends]
        cv2.line(image, *places, (SHADED_METAL,) * 3, 5, cv2.LINE_AA, shift=4)
    soft = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 0.7)
    return np.clip(soft + np.random.default_rng(1).normal(0, noise, soft.shape), 0, 255).astype(np.uint8)


def test_learns_the_background_beside_the_needle_and_under_it_once_it_has_gone(eye):
    background = Background(eye)
    line = Line(eye.inwards_rad, 0.0)
    x, y = (round(value) for value in line.at_px(eye.trocar_px, 40.0))
    ends = line.at_px(eye.trocar_px, -200.0), line.at_px(eye.trocar_px, 103.0)
    background.learn(draw_eye(eye, GREY_GROUND, DEPTH_PX, noise=0), ends, 20)
    assert background.grey[y, x] == UNOBSERVED
    assert background.grey[y, x + 40] == GREY_GROUND[0]
    for _ in range(16):
        background.learn(draw_eye(eye, GREY_GROUND, noise=0), None, 20)
    assert background.grey[y, x] == GREY_GROUND[0]
    assert all((background.grey[band] >= 0).all() for band in eye.bands(16))
    background.reset()
    assert (background.grey == UNOBSERVED).all()


def test_within_reach_the_same_grey_is_learned_and_no_more(eye):
    whole, near = Background(eye), Background(eye, reach_px=eye.inner_px / 2)
    row, column = np.ogrid[: eye.height_px, : eye.width_px]
    x, y = eye.center_px
    for number in range(20):
        image = draw_eye(eye, ORANGE_GROUND, DEPTH_PX + number)
        ends = eye.trocar_px, Line(eye.inwards_rad, 0.0).at_px(eye.trocar_px, DEPTH_PX + number)
        whole.learn(image, ends, 20), near.learn(image, ends, 20)
    is_near = np.hypot(column - x, row - y) <= eye.inner_px / 2
    assert (near.grey[is_near] == whole.grey[is_near]).all()
    assert (near.grey >= 0).sum() < 0.5 * (whole.grey >= 0).sum()
    assert whole.chroma.any() and not near.chroma.any()


def test_uses_colour_the_more_the_less_blue_the_background_is(eye):
    def share(ground) -> float:
        background = Background(eye)
        background.learn(draw_eye(eye, ground), None, 20)
        return background.chroma_share

    assert share(GREY_GROUND) == share((180, 150, 120)) == share((130, 140, 145)) == 0
    assert 0 < share((57, 65, 85)) < share(ORANGE_GROUND)
    background = Background(eye)
    background.learn(grey_of(draw_eye(eye, ORANGE_GROUND)), None, 20)
    assert background.chroma_share == 0


def test_an_eye_without_needle_has_no_excess_over_itself_in_any_colour(eye):
    background = Background(eye)
    background.learn(draw_eye(eye, ORANGE_GROUND, noise=0), None, 20)
    line = Line(eye.inwards_rad + 0.1, 0.0)
    (strip,) = background.rectify(draw_eye(eye, ORANGE_GROUND, noise=0), line, stations(eye, line))
    excess = np.concatenate([strip.excess[:, strip.outside], strip.excess[:, strip.inside]], axis=1)
    assert np.abs(excess).max() < 1


def test_detects_a_needle_as_bright_as_an_orange_background(eye, registration):
    perceive = Tracker(registration, PerceptionConfig())
    true_px = Line(eye.inwards_rad, 0.0).at_px(eye.trocar_px, DEPTH_PX)
    for number in range(3):
        depth_px = DEPTH_PX if number else None
        observation = perceive(Capture(number, number * 33_000_000, draw_eye(eye, ORANGE_GROUND, depth_px)))
        assert ("needle_tip" in observation.found) == (depth_px is not None)
    step = perceive.detect(draw_eye(eye, ORANGE_GROUND, DEPTH_PX), 99_000_000)
    assert norm(subtract(step.line.at_px(eye.trocar_px, step.tip.u_px), true_px)) < 1
    tip_px = registration.image.to_px(observation.found["needle_tip"].at_mm)
    sd_px = observation.certainty.tip_sd_mm / registration.image.mm_per_px
    assert norm(subtract(tip_px, true_px)) < 2 * sd_px < 3  # a blunt end that mirrors nothing


def test_detects_a_needle_in_the_first_image_by_its_colour(eye, registration):
    perceive = Tracker(registration, PerceptionConfig())
    observation = perceive(Capture(0, 0, draw_eye(eye, ORANGE_GROUND, DEPTH_PX)))
    assert "needle_tip" in observation.found


@pytest.mark.parametrize("light", [0.35, 1.0])
def test_detects_a_needle_in_dim_light(eye, registration, light):
    perceive = Tracker(registration, PerceptionConfig())
    for number in range(3):
        image = draw_eye(eye, (138, 138, 138), DEPTH_PX if number else None, noise=0)
        grain = np.random.default_rng(number).normal(0, 0.4, image.shape[:2])[..., None]
        dim = np.clip(np.rint(light * image + grain), 0, 255).astype(np.uint8)
        observation = perceive(Capture(number, number * 33_000_000, dim))
        assert ("needle_tip" in observation.found) == bool(number)


def test_measures_the_light_by_the_brightest_pixels_except_in_the_dark(eye):
    background = Background(eye)

    def light(share: float) -> float:
        background.measure_light((share * draw_eye(eye, GREY_GROUND, noise=0)).astype(np.uint8))
        return background.light

    assert light(0.5) == pytest.approx(128 / 75, abs=0.05)
    background.learn(draw_eye(eye, GREY_GROUND), None, 20)  # light may change later
    assert light(1.0) == 1
    assert light(0.5) == pytest.approx(128 / 75, abs=0.05)
    assert light(0.1) == light(0.0) == 1


def registered(image, unknown=slice(0, 0)) -> BackgroundImage:
    is_known = np.ones(image.shape[:2], bool)
    is_known[unknown] = False
    return BackgroundImage(image, is_known)


def with_vessels(eye, image):
    """Dark vessels across and along the needle's path."""
    drawn = image.copy()
    for along_px, turn_rad in ((60.0, 1.2), (130.0, 0.1)):
        at_px = Line(eye.inwards_rad, 0.0).at_px(eye.trocar_px, along_px)
        ends = [Line(eye.inwards_rad + turn_rad, 0.0).at_px(at_px, along) for along in (-30.0, 30.0)]
        cv2.line(
            drawn, *(tuple(round(value) for value in end) for end in ends), (60, 60, 100), 3, cv2.LINE_AA
        )
    return drawn


@pytest.mark.parametrize("light", [0.7, 1.0, 1.2])
def test_what_a_needle_occludes_from_the_first_image_on_is_as_registered(eye, light):
    before = registered(draw_eye(eye, GREY_GROUND, noise=0), slice(0, 1))
    background = Background(eye, before)
    now = np.clip(light * draw_eye(eye, GREY_GROUND, DEPTH_PX, noise=0), 0, 255).astype(np.uint8)
    line = Line(eye.inwards_rad, 0.0)
    x, y = (round(value) for value in line.at_px(eye.trocar_px, 40.0))
    background.learn(now, (line.at_px(eye.trocar_px, -200.0), line.at_px(eye.trocar_px, 103.0)), 20)
    assert background.grey[y, x] == pytest.approx(light * GREY_GROUND[0], rel=0.01)
    assert background.grey[y, x + 40] == now[y, x + 40, 0]  # a new image replaces it
    background.learn(now, None, 20)
    for _ in range(15):
        background.learn(now, None, 20)
    assert background.grey[y, x] == now[y, x, 0]
    background.reset()
    assert (background.grey == UNOBSERVED).all()
    background.measure_light(now)
    assert background.grey[y, x] == pytest.approx(light * GREY_GROUND[0], rel=0.01)
    assert background.grey[0, 0] == UNOBSERVED


@pytest.mark.parametrize("change", ["moved", "lit from the side", "another size of eye"])
def test_ignores_the_registered_background_of_an_eye_that_looks_different_now(eye, change):
    before = draw_eye(eye, GREY_GROUND, noise=0)
    height, width = before.shape[:2]
    now = {
        "moved": np.roll(before, 60, axis=1),
        "lit from the side": before * np.linspace(0.4, 1.6, width)[:, None],
        "another size of eye": cv2.resize(before, None, fx=1.5, fy=1.5)[:height, :width],
    }[change]
    background = Background(eye, registered(before))
    background.measure_light(np.clip(now, 0, 255).astype(np.uint8))
    assert (background.grey == UNOBSERVED).all()


def test_a_run_may_begin_with_the_needle_in_an_eye_whose_background_is_registered(eye, registration):
    clean = with_vessels(eye, draw_eye(eye, GREY_GROUND, noise=0))
    drawn = draw_eye(eye, GREY_GROUND, DEPTH_PX)
    image = np.where(drawn < 140, drawn, with_vessels(eye, drawn))
    true_px = Line(eye.inwards_rad, 0.0).at_px(eye.trocar_px, DEPTH_PX)

    def error_px(background: BackgroundImage | None) -> float:
        perceive = Tracker(replace(registration, background=background), PerceptionConfig())
        tip = perceive(Capture(0, 0, image)).found["needle_tip"]
        return norm(subtract(registration.image.to_px(tip.at_mm), true_px))

    assert error_px(registered(clean)) < 2
    assert error_px(None) > 10  # a vessel along its path is mistaken for a part of it
