import cv2
import numpy as np
import pytest
from drawn_strip import draw_needle, draw_rim
from msgspec.structs import replace

from haptigraph.config import PerceptionConfig
from haptigraph.messages import Capture
from haptigraph.perception.needle.rectify import EyeGeometry, Line
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.perception.needle.visible_globe import VisibleGlobe
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.eye.palette import Appearance
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario


@pytest.fixture(scope="module", params=["light", "dark"])
def phantom(request):
    """The registration and the first image of an eye."""
    scenario = replace(load_scenario("align_then_approach"), appearance=Appearance(request.param))
    played = Phantom(scenario)
    return parse_registration(played.registration, "eye"), played.advance().image


def moved(image, off_px):
    size = image.shape[1::-1]
    return cv2.warpAffine(
        image, np.array([[1.0, 0, off_px], [0, 1, 0]]), size, borderMode=cv2.BORDER_REPLICATE
    )


DEGRADED = {
    "as it is": lambda image, rng: image,
    "grey": lambda image, rng: cv2.cvtColor(image, cv2.COLOR_BGR2GRAY),
    "dim": lambda image, rng: (0.3 * image).astype(np.uint8),
    "blurred": lambda image, rng: cv2.GaussianBlur(image, (0, 0), 5),
    "noisy": lambda image, rng: np.clip(image + rng.normal(0, 12, image.shape), 0, 255).astype(np.uint8),
    "moved a little": lambda image, rng: moved(image, 8),
}


@pytest.mark.parametrize("name", DEGRADED)
def test_sees_the_registered_eye(phantom, name):
    registration, image = phantom
    assert VisibleGlobe(EyeGeometry(registration))(DEGRADED[name](image, np.random.default_rng(1)))


def test_sees_no_eye_elsewhere(phantom):
    registration, image = phantom
    assert not VisibleGlobe(EyeGeometry(registration))(moved(image, 60))


@pytest.mark.parametrize("seed", range(5))
def test_sees_no_eye_in_noise_of_any_fineness_or_in_stripes(eye, seed):
    rng = np.random.default_rng(seed)
    grain = cv2.GaussianBlur(rng.normal(0, 1, (eye.height_px, eye.width_px)), (0, 0), 0.3 + 2 * seed)
    y, x = np.mgrid[: eye.height_px, : eye.width_px]
    stripes = np.sin(2 * np.pi * (x * np.cos(seed) + y * np.sin(seed)) / (5 + 9 * seed))
    for picture in (grain / grain.std(), stripes):
        assert not VisibleGlobe(eye)((128 + 40 * picture).clip(0, 255).astype(np.uint8))


def test_an_even_picture_shows_no_eye(eye):
    assert not VisibleGlobe(eye)(np.full((eye.height_px, eye.width_px), 99, np.uint8))


def test_nobody_can_tell_where_the_rim_is_out_of_view(phantom):
    registration, image = phantom
    near = replace(
        registration, image=replace(registration.image, mm_per_px=registration.image.mm_per_px / 8)
    )
    assert VisibleGlobe(EyeGeometry(near))(np.zeros_like(image))


def test_what_looks_like_a_needle_is_one_only_in_an_eye(phantom):
    registration, _ = phantom
    eye = EyeGeometry(registration)
    rod = draw_needle(eye, Line(eye.inwards_rad + 0.1, 0.0), 8 * eye.px_per_mm)
    observations = [
        Tracker(registration, PerceptionConfig())(Capture(0, 0, image))
        for image in (rod, draw_rim(rod.copy(), eye))
    ]
    assert ["needle_line" in each.found for each in observations] == [False, True]
    assert [[fault.where for fault in each.faults] for each in observations] == [["registration"], []]
