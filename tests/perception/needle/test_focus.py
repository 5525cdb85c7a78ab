from functools import cache
from itertools import pairwise

import cv2
import numpy as np
import pytest
from helpers import mostly_slow
from msgspec.structs import replace

from haptigraph.perception.needle.focus import EVERY, Focus
from haptigraph.perception.needle.rectify import EyeGeometry
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.eye.palette import Appearance
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario


@pytest.fixture(scope="module", params=mostly_slow(["light", "dark"], "dark"))
def show(request):
    """A function that returns the registration, and an image with so much blur of the lens, in px."""

    @cache
    def shown(blur_px):
        scenario = load_scenario("align_then_approach")
        camera = replace(scenario.camera, blur_px=blur_px)
        played = Phantom(replace(scenario, appearance=Appearance(request.param), camera=camera))
        return parse_registration(played.registration, "eye"), played.advance().image

    return shown


def measured_px(registration, image) -> float:
    focus = Focus(EyeGeometry(registration))
    focus.measure(image)
    return focus.blur_px


def test_the_rim_shows_at_most_the_blur_of_the_lens_and_more_of_more(show):
    actual_px = [0.5, 0.8, 1.2, 1.6, 2.0]
    shown_px = [measured_px(*show(blur_px)) for blur_px in actual_px]
    assert all(0.5 * actual < shown < actual for actual, shown in zip(actual_px, shown_px, strict=True))
    assert all(more > 1.05 * less for less, more in pairwise(shown_px))


def test_more_blur_is_measured_as_more_in_grey_and_noise_too(show):
    rng = np.random.default_rng(1)
    for degrade in (
        lambda image: cv2.cvtColor(image, cv2.COLOR_BGR2GRAY),
        lambda image: np.clip(image + rng.normal(0, 4, image.shape), 0, 255).astype(np.uint8),
    ):
        sharp, soft = ((registration, degrade(image)) for registration, image in (show(0.8), show(2.0)))
        assert measured_px(*soft) > measured_px(*sharp) + 0.3


def test_motion_does_not_count_as_blur_of_the_lens(show):
    registration, image = show(0.8)
    moving = cv2.blur(image, (9, 1))
    assert measured_px(registration, moving) < 0.5 * measured_px(registration, cv2.blur(image, (9, 9)))


def test_an_image_without_a_rim_shows_no_blur(show):
    registration, image = show(2.0)
    assert measured_px(registration, np.full_like(image, 90)) == 0.0


def test_the_blur_is_measured_in_every_16th_image(show):
    (registration, sharp), (_, soft) = show(0.8), show(2.0)
    focus = Focus(EyeGeometry(registration))
    focus.measure(sharp)
    before_px = focus.blur_px
    for _ in range(EVERY - 1):
        focus.measure(soft)
    assert focus.blur_px == before_px
    focus.measure(soft)
    assert focus.blur_px > before_px + 0.3
    focus.reset()
    assert focus.blur_px == 0.0
