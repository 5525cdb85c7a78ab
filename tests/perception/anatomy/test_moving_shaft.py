import math

import cv2
import numpy as np
import pytest
from helpers import draw_rod
from paths import RENDERINGS

from haptigraph.analysis.registering.registering import all_images
from haptigraph.perception.anatomy.moving_shaft import find_rcms, median_image
from haptigraph.perception.anatomy.rim import find_rim
from haptigraph.registration.loading import load_registration

RENDERING = RENDERINGS / "golden_thin"
TRUTH = load_registration(RENDERING / "registration.toml")


@pytest.fixture(scope="module")
def images():
    return list(all_images(str(RENDERING / "clip.mp4")))[::2]


def rcms_of(images):
    reference = median_image(images)
    return find_rcms(images, reference, find_rim(reference))


def error_px(images):
    """Distance of the RCM found from the true one."""
    (rcm,) = rcms_of(images)
    return math.dist(rcm.point_px, TRUTH.image.to_px(TRUTH.trocar.at_mm))


def lit(image, light):
    return np.clip(np.rint(image * light), 0, 255).astype(np.uint8)


def test_the_rcm_of_a_needle_is_found(images):
    assert error_px(images) < 2


@pytest.mark.slow
def test_changes_of_exposure_do_not_count_as_motion(images):
    rng = np.random.default_rng(3)
    assert error_px([lit(image, rng.uniform(0.7, 1.25)) for image in images]) < 2


@pytest.mark.slow
def test_a_shadow_that_sweeps_over_the_eye_does_not_count_as_motion(images):
    x = np.linspace(0, 1, images[0].shape[1])[None, :, None]
    sweeps = np.linspace(-0.3, 1.3, len(images))
    lights = [1 - 0.6 * np.exp(-(((x - at) / 0.15) ** 2)) for at in sweeps]
    assert error_px([lit(image, light) for image, light in zip(images, lights, strict=True)]) < 2


@pytest.mark.slow
def test_a_static_bar_is_not_the_needle_even_if_it_flickers(images):
    rng = np.random.default_rng(4)
    (x, y), radius_px = TRUTH.image.center_px, find_rim(median_image(images)).inner.radius_px
    ends = [(round(x + at * radius_px), round(y + up * radius_px)) for at, up in ((-1.3, -0.5), (1.3, -0.5))]
    barred = []
    for image in images:
        grey = rng.integers(20, 44)
        barred.append(cv2.line(image.copy(), *ends, (int(grey),) * 3, 9, cv2.LINE_AA))
    assert error_px(barred) < 2


def test_of_two_objects_that_turn_both_rcms_are_returned(images):
    (x, y), wall_px = TRUTH.image.center_px, 1.07 * TRUTH.globe.radius_mm / TRUTH.image.mm_per_px
    other = x - wall_px * math.sin(math.radians(36)), y - wall_px * math.cos(math.radians(36))
    both = []
    for number, image in enumerate(images):
        both.append(image.copy())
        draw_rod(both[-1], other, math.radians(20 + 12 * math.sin(number / 5)), (-250, 150), 9)
    one, another = sorted(rcms_of(both), key=lambda rcm: rcm.point_px)
    assert math.dist(one.point_px, other) < 3
    assert math.dist(another.point_px, TRUTH.image.to_px(TRUTH.trocar.at_mm)) < 3
