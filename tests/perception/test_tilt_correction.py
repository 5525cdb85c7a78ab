"""From a tilted camera to the needle's position, end to end."""

import math

import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from haptigraph import assemble
from haptigraph.config import load_config
from haptigraph.errors import BadInput
from haptigraph.geometry import Point
from haptigraph.imaging import tilt_corrected, tilt_restored
from haptigraph.lens import Lens
from haptigraph.messages import Capture
from haptigraph.perception.eye_view import IoctView
from haptigraph.projection import LensMap
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.eye.eye import registration_text
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario


def tilted_phantom(quick: str, tilt_deg: tuple[float, float], **others) -> Phantom:
    scenario = load_scenario(quick)
    camera = replace(scenario.camera, tilt_deg=tilt_deg, distance_mm=120.0, **others)
    return Phantom(replace(scenario, camera=camera))


@pytest.fixture(scope="module")
def phantom(quick) -> Phantom:
    return tilted_phantom(
        quick, (-8.0, 11.0), width_px=960, height_px=540, center_px=(480.0, 296.0), px_per_mm=16.0
    )


@pytest.mark.parametrize("perceiver", ["tracker", "threshold"])
def test_locates_tips_in_millimetres(phantom, procedure, perceiver):
    registration = parse_registration(phantom.registration, "truth")
    config = load_config(None, (f'perception.perceiver="{perceiver}"', "perception.alpha=1"))
    pipeline = assemble.build_pipeline(config, registration, procedure)
    phantom.restart()
    errors_mm = []
    for number in range(60):
        moment = phantom.advance()
        assert moment is not None
        step = pipeline.step(Capture(number, round(number * 1e9 / 15), moment.image))
        tip = step.observation.found.get("needle_tip")
        if moment.truth.inside and moment.truth.depth_mm > 3 and isinstance(tip, Point):
            errors_mm.append(math.dist(tip.at_mm, moment.truth.tip_mm))
    assert len(errors_mm) > 20
    assert np.median(errors_mm) < 0.15


def test_corrects_a_tilted_image(quick):
    tilted, frontal = (
        tilted_phantom(quick, tilt_deg, read_noise_grey=0.0, shot_noise_grey=0.0)
        for tilt_deg in ((0.0, 12.0), (0.0, 0.0))
    )
    registration = parse_registration(tilted.registration, "truth")
    image, expected = tilted.advance().image, frontal.advance().image
    found = tilt_corrected(image, registration.image.frontal_from_image)
    eye = np.s_[60:236, 150:330]
    off, off_before = (cv2.norm(each[eye], expected[eye], cv2.NORM_L1) for each in (found, image))
    assert off < 0.4 * off_before
    view, plain = IoctView(registration, 200), IoctView(registration.frontal, 200)
    assert cv2.norm(view(image), plain(expected), cv2.NORM_L1) / 200**2 < 3


def test_refuses_images_of_another_size(phantom, procedure):
    registration = parse_registration(phantom.registration, "truth")
    pipeline = assemble.build_pipeline(load_config(None, ()), registration, procedure)
    with pytest.raises(BadInput, match="960 x 540"):
        pipeline.step(Capture(0, 0, np.zeros((10, 10, 3), np.uint8)))


def test_locates_tips_through_a_lens_and_repeats_exactly(phantom, procedure):
    lens = Lens((800.0, 800.0), (470.0, 280.0), (-0.2, 0.0, 0.0, 0.0, 0.0))
    seen = LensMap(lens, phantom.camera.geometry.frontal_from_image)
    geometry = replace(phantom.camera.geometry, frontal_from_image=seen)
    registration = parse_registration(registration_text(phantom.eye, geometry, 960, 540), "truth")
    config = load_config(None, ('perception.perceiver="tracker"',))
    phantom.restart()
    moments = [phantom.advance() for _ in range(40)]
    captures = [
        Capture(number, round(number * 1e9 / 15), tilt_restored(moment.image, LensMap(lens)))
        for number, moment in enumerate(moments)
    ]
    first, again = (
        [pipeline.step(capture).observation for capture in captures]
        for pipeline in (assemble.build_pipeline(config, registration, procedure) for _ in range(2))
    )
    assert first == again
    errors_mm = [
        math.dist(found.found["needle_tip"].at_mm, moment.truth.tip_mm)
        for found, moment in zip(first, moments, strict=True)
        if moment.truth.inside and moment.truth.depth_mm > 3 and "needle_tip" in found.found
    ]
    assert len(errors_mm) > 10
    assert np.median(errors_mm) < 0.15
