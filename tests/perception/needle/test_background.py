import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from haptigraph.config import PerceptionConfig
from haptigraph.geometry import norm, subtract
from haptigraph.imaging import grey_of
from haptigraph.messages import Capture
from haptigraph.perception.needle.background import Background
from haptigraph.perception.needle.rectify import UNOBSERVED, Line, Site, stations
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.registration.background import BackgroundImage

GREY_GROUND, ORANGE_GROUND = (150, 150, 150), (69, 101, 148)
SHADED_METAL = 111  # as bright as that orange is
DEPTH_PX = 100.0


def eye(site: Site, ground: tuple[int, int, int], depth_px: float | None = None, noise: float = 1.0):
    """An eye of one colour on a dark table, with or without a needle as grey as metal in its shade."""
    image = np.full((site.height_px, site.width_px, 3), 50, np.uint8)
    center_px = tuple(round(value) for value in site.center_px)
    cv2.circle(image, center_px, round(site.outer_px), ground, -1)
    if depth_px is not None:
        line = Line(site.inwards_rad, 0.0)
        ends = (line.at_px(site.trocar_px, along) for along in (-90.0, depth_px - 2.5))
        places = [tuple(round(16 * value) for value in end) for end in ends]
        cv2.line(image, *places, (SHADED_METAL,) * 3, 5, cv2.LINE_AA, shift=4)
    soft = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 0.7)
    return np.clip(soft + np.random.default_rng(1).normal(0, noise, soft.shape), 0, 255).astype(np.uint8)


def test_the_background_is_learned_beside_the_needle_and_under_it_when_it_has_gone(site):
    background = Background(site)
    line = Line(site.inwards_rad, 0.0)
    x, y = (round(value) for value in line.at_px(site.trocar_px, 40.0))
    ends = line.at_px(site.trocar_px, -200.0), line.at_px(site.trocar_px, 103.0)
    background.learn(eye(site, GREY_GROUND, DEPTH_PX, noise=0), ends, 20)
    assert background.grey[y, x] == UNOBSERVED
    assert background.grey[y, x + 40] == GREY_GROUND[0]
    for _ in range(16):
        background.learn(eye(site, GREY_GROUND, noise=0), None, 20)
    assert background.grey[y, x] == GREY_GROUND[0]
    assert (background.grey[site.box] >= 0).all()
    background.reset()
    assert (background.grey == UNOBSERVED).all()


def test_colour_counts_as_far_as_the_ground_is_short_of_blue(site):
    def share(ground) -> float:
        background = Background(site)
        background.learn(eye(site, ground), None, 20)
        return background.chroma_share

    assert share(GREY_GROUND) == share((180, 150, 120)) == share((130, 140, 145)) == 0
    assert 0 < share((57, 65, 85)) < share(ORANGE_GROUND)
    background = Background(site)
    background.learn(grey_of(eye(site, ORANGE_GROUND)), None, 20)
    assert background.chroma_share == 0


def test_an_eye_that_is_empty_shows_no_difference_from_itself_in_any_colour(site):
    background = Background(site)
    background.learn(eye(site, ORANGE_GROUND, noise=0), None, 20)
    line = Line(site.inwards_rad + 0.1, 0.0)
    (strip,) = background.strips(eye(site, ORANGE_GROUND, noise=0), line, stations(site, line))
    seen = np.concatenate([strip.excess[:, strip.before], strip.excess[:, strip.inside]], axis=1)
    assert np.abs(seen).max() < 1


def test_a_needle_as_bright_as_orange_ground_is_found(site, registration):
    perceive = Tracker(registration, PerceptionConfig())
    true_px = Line(site.inwards_rad, 0.0).at_px(site.trocar_px, DEPTH_PX)
    for number in range(3):
        depth_px = DEPTH_PX if number else None
        seen = perceive(Capture(number, number * 33_000_000, eye(site, ORANGE_GROUND, depth_px)))
        assert ("needle_tip" in seen.found) == (depth_px is not None)
    tip_px = registration.image.to_px(seen.found["needle_tip"].at_mm)
    assert norm(subtract(tip_px, true_px)) < 1


def test_a_needle_in_the_very_first_image_is_found_by_its_colour(site, registration):
    perceive = Tracker(registration, PerceptionConfig())
    seen = perceive(Capture(0, 0, eye(site, ORANGE_GROUND, DEPTH_PX)))
    assert "needle_tip" in seen.found


@pytest.mark.parametrize("light", [0.35, 1.0])
def test_a_needle_is_found_in_dim_light_as_well(site, registration, light):
    perceive = Tracker(registration, PerceptionConfig())
    for number in range(3):
        image = eye(site, (138, 138, 138), DEPTH_PX if number else None, noise=0)
        grain = np.random.default_rng(number).normal(0, 0.4, image.shape[:2])[..., None]
        dim = np.clip(np.rint(light * image + grain), 0, 255).astype(np.uint8)
        seen = perceive(Capture(number, number * 33_000_000, dim))
        assert ("needle_tip" in seen.found) == bool(number)


def test_light_is_told_by_what_is_brightest_and_not_in_the_dark(site):
    background = Background(site)

    def light(share: float) -> float:
        background.look((share * eye(site, GREY_GROUND, noise=0)).astype(np.uint8))
        return background.light

    assert light(0.5) == pytest.approx(128 / 75, abs=0.05)
    background.learn(eye(site, GREY_GROUND), None, 20)  # light may change later
    assert light(1.0) == 1
    assert light(0.5) == pytest.approx(128 / 75, abs=0.05)
    assert light(0.1) == light(0.0) == 1


def registered(image, hidden=slice(0, 0)) -> BackgroundImage:
    is_known = np.ones(image.shape[:2], bool)
    is_known[hidden] = False
    return BackgroundImage(image, is_known)


def with_vessels(site, image):
    """Dark vessels that run across and along the needle's way."""
    drawn = image.copy()
    for along_px, turn_rad in ((60.0, 1.2), (130.0, 0.1)):
        at_px = Line(site.inwards_rad, 0.0).at_px(site.trocar_px, along_px)
        ends = [Line(site.inwards_rad + turn_rad, 0.0).at_px(at_px, along) for along in (-30.0, 30.0)]
        cv2.line(
            drawn, *(tuple(round(value) for value in end) for end in ends), (60, 60, 100), 3, cv2.LINE_AA
        )
    return drawn


@pytest.mark.parametrize("light", [0.7, 1.0, 1.2])
def test_what_a_needle_hides_from_the_first_image_on_is_as_it_was_registered(site, light):
    background = registered(eye(site, GREY_GROUND, noise=0), slice(0, 1))
    background = Background(site, background)
    now = np.clip(light * eye(site, GREY_GROUND, DEPTH_PX, noise=0), 0, 255).astype(np.uint8)
    line = Line(site.inwards_rad, 0.0)
    x, y = (round(value) for value in line.at_px(site.trocar_px, 40.0))
    background.learn(now, (line.at_px(site.trocar_px, -200.0), line.at_px(site.trocar_px, 103.0)), 20)
    assert background.grey[y, x] == pytest.approx(light * GREY_GROUND[0], rel=0.01)
    assert background.grey[y, x + 40] == now[y, x + 40, 0]  # what is seen counts for more
    background.learn(now, None, 20)
    for _ in range(15):
        background.learn(now, None, 20)
    assert background.grey[y, x] == now[y, x, 0]
    background.reset()
    assert (background.grey == UNOBSERVED).all()
    background.look(now)
    assert background.grey[y, x] == pytest.approx(light * GREY_GROUND[0], rel=0.01)
    assert background.grey[0, 0] == UNOBSERVED


@pytest.mark.parametrize("change", ["moved", "lit from the side", "another size of eye"])
def test_an_eye_that_looks_different_by_now_is_not_remembered(site, change):
    before = eye(site, GREY_GROUND, noise=0)
    height, width = before.shape[:2]
    now = {
        "moved": np.roll(before, 60, axis=1),
        "lit from the side": before * np.linspace(0.4, 1.6, width)[:, None],
        "another size of eye": cv2.resize(before, None, fx=1.5, fy=1.5)[:height, :width],
    }[change]
    background = Background(site, registered(before))
    background.look(np.clip(now, 0, 255).astype(np.uint8))
    assert (background.grey == UNOBSERVED).all()


def test_a_run_may_begin_with_the_needle_in_an_eye_that_was_registered_empty(site, registration):
    clean = with_vessels(site, eye(site, GREY_GROUND, noise=0))
    seen = eye(site, GREY_GROUND, DEPTH_PX)
    image = np.where(seen < 140, seen, with_vessels(site, seen))
    true_px = Line(site.inwards_rad, 0.0).at_px(site.trocar_px, DEPTH_PX)

    def miss_px(background: BackgroundImage | None) -> float:
        perceive = Tracker(replace(registration, background=background), PerceptionConfig())
        tip = perceive(Capture(0, 0, image)).found["needle_tip"]
        return norm(subtract(registration.image.to_px(tip.at_mm), true_px))

    assert miss_px(registered(clean)) < 1
    assert miss_px(None) > 10  # a vessel along its way is taken for a part of it
