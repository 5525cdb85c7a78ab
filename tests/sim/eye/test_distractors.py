import math

import numpy as np
import pytest
from msgspec.structs import replace

from haptigraph.geometry import norm, rotate, subtract, unit
from haptigraph.sim.eye.camera import Camera
from haptigraph.sim.eye.distractors import Distractors
from haptigraph.sim.eye.eye import Eye, EyeShape, RegistrationError, registration_text
from haptigraph.sim.eye.needle import NeedleShape
from haptigraph.sim.eye.optics import CameraSettings
from haptigraph.sim.eye.palette import Appearance

SMALL = CameraSettings(
    width_px=480,
    height_px=270,
    center_px=(240.0, 148.0),
    px_per_mm=8.0,
    blur_px=0.5,
    read_noise_grey=0.0,
    shot_noise_grey=0.0,
)
EYE = Eye(EyeShape())
TIP_MM = (0.0, -2.0)
ALONG = unit(subtract(TIP_MM, EYE.trocar_mm))
AWAY = (0.0, 200.0), (0.0, -1.0)


def camera(needle=None, **distractors):
    needle = needle or NeedleShape(brightness=0.3)
    return Camera(EYE, SMALL, needle, Appearance(), 3, Distractors(**distractors))


def in_bowl(camera, image):
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    return image[np.hypot(x - camera.settings.center_px[0], y - camera.settings.center_px[1]) < 90]


def test_default_distractors_change_nothing():
    plain = Camera(EYE, SMALL, NeedleShape(), Appearance(), 3)
    given = Camera(EYE, SMALL, NeedleShape(), Appearance(), 3, Distractors())
    assert np.array_equal(plain.render(TIP_MM, ALONG, 5), given.render(TIP_MM, ALONG, 5))


def test_the_second_instrument_enters_through_the_other_trocar_and_is_static():
    plain, piped = camera(), camera(light_pipe_mm=10.0, light_pipe_deg=5.0)
    changed = np.abs(piped.render(*AWAY, 0).astype(int) - plain.render(*AWAY, 0)).max(axis=2) > 15
    rows, columns = np.nonzero(changed)
    rcm = EYE.other_trocar_mm
    along = rotate(unit((-rcm[0], -rcm[1])), 5.0)
    tip_px = plain.geometry.to_px((rcm[0] + 10 * along[0], rcm[1] + 10 * along[1]))
    lowest = rows.argmax()
    assert math.dist((columns[lowest], rows[lowest]), tip_px) < 4
    assert np.array_equal(piped.render(*AWAY, 0), piped.render(*AWAY, 1))


def test_specular_highlights_saturate_and_are_static():
    lens = camera(specular_highlights=12)
    image = lens.render(*AWAY, 0)
    assert in_bowl(lens, image).min(axis=1).max() == 255
    assert in_bowl(lens, camera().render(*AWAY, 0)).max() < 250
    assert np.array_equal(image, lens.render(*AWAY, 1))


def test_bubbles_drift_slowly_and_depend_only_on_the_image_number():
    lens, still = camera(bubbles=6), camera().render(*AWAY, 0).astype(int)
    first, second = (lens.render(*AWAY, number).astype(int) for number in (0, 1))
    assert np.array_equal(lens.render(*AWAY, 0), first)
    assert not np.array_equal(first, second)
    assert (first - still).max() > 40  # bright rings
    assert (still - first).max() > 40  # dark debris
    assert (np.abs(first - still).max(axis=2) > 10).mean() < 0.02


def test_bubbles_are_still_in_the_bowl_after_an_hour():
    lens, still = camera(bubbles=40), camera().render(*AWAY, 0).astype(int)
    changed = np.abs(lens.render(*AWAY, 108_000).astype(int) - still).max(axis=2) > 40
    assert changed.any()
    rows, columns = np.nonzero(changed)
    assert np.hypot(columns - SMALL.center_px[0], rows - SMALL.center_px[1]).max() < 12 * 8


def test_flicker_scales_the_whole_image_by_its_standard_deviation():
    lens, still = camera(flicker=0.1), camera().render(*AWAY, 0)
    gains = np.array([in_bowl(lens, lens.render(*AWAY, n)).mean() for n in range(60)])
    gains /= in_bowl(lens, still).mean()
    assert gains.std() == pytest.approx(0.1, rel=0.4)
    assert gains[7] == in_bowl(lens, lens.render(*AWAY, 7)).mean() / in_bowl(lens, still).mean()


def test_a_tilted_needle_is_foreshortened_towards_the_same_tip():
    shape = NeedleShape(brightness=0.2, taper_mm=8.0, diameter_mm=0.9)
    flat, tilted = camera(shape), camera(replace(shape, tilt_deg=60.0))
    bare = camera().render(*AWAY, 0).astype(int)
    widths = []
    for lens in (flat, tilted):
        dark = (bare - lens.render(TIP_MM, ALONG, 0)).max(axis=2) > 40
        assert np.nonzero(dark)[0].max() == pytest.approx(lens.geometry.to_px(TIP_MM)[1], abs=2.5)
        at = TIP_MM[0] - 3 * ALONG[0], TIP_MM[1] - 3 * ALONG[1]
        widths.append(dark[round(lens.geometry.to_px(at)[1])].sum())
    assert widths[1] > 1.4 * widths[0]  # half as long a cone is twice as wide so near to the tip


def test_the_expected_image_is_the_mean_of_rendered_images():
    settings = replace(SMALL, read_noise_grey=2.0, shot_noise_grey=4.0)
    lens = Camera(EYE, settings, NeedleShape(), Appearance(), 3)
    images = np.array([lens.render(TIP_MM, ALONG, n)[..., 1] for n in range(100)], np.float64)
    colour = Camera(EYE, replace(SMALL), NeedleShape(), Appearance(), 3).render(TIP_MM, ALONG, 0)[..., 1]
    grey, sd_grey = lens.expect(TIP_MM, ALONG)
    assert np.abs(images.mean(axis=0) - colour).mean() < 0.5
    assert images.std(axis=0, ddof=1).mean() == pytest.approx(sd_grey.mean(), rel=0.05)
    assert grey.shape == sd_grey.shape == colour.shape
    assert np.abs(grey - colour).mean() < 12  # nearly without colour


def test_a_registration_error_shifts_the_registered_anatomy():
    image = camera().geometry
    right = registration_text(EYE, image, 480, 270)
    assert registration_text(EYE, image, 480, 270, RegistrationError()) == right
    wrong = registration_text(EYE, image, 480, 270, RegistrationError((1.0, -2.0), (3.0, 0.0), (0.0, 2.5)))
    assert "center_px = [241.000, 146.000]" in wrong
    x, y = image.to_px(EYE.trocar_mm)
    assert f"point_px = [{x:.3f}, {y + 2.5:.3f}]" in wrong
    x, y = image.to_px(EYE.target_mm)
    assert f"point_px = [{x + 3:.3f}, {y:.3f}]" in wrong
    assert norm(EYE.target_mm) == pytest.approx(12.0)
