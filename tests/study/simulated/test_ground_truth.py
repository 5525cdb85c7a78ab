"""The simulator's ground truth, observed with the tracker's noise."""

import numpy as np
import pytest

from haptigraph.geometry import angle_between_deg, subtract
from haptigraph.messages import Capture
from haptigraph.registration.loading import parse_camera_registration
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario
from haptigraph.study.simulated.ground_truth import (
    NOISE_DEG,
    NOISE_DEPTHS_MM,
    GroundTruthPerceiver,
    angle_noise_deg,
)

IMAGES = 200  # more than are drawn at once


@pytest.fixture(scope="module")
def registration():
    return parse_camera_registration(Phantom(load_scenario("align_then_approach")).registration, "the eye")


@pytest.fixture(scope="module")
def capture():
    phantom = Phantom(load_scenario("align_then_approach"))
    moments = (phantom.advance(draws=False) for _ in range(2000))
    truth = next(moment.truth for moment in moments if moment.truth.visible and moment.truth.depth_mm > 10)
    return Capture(0, 0, None, truth=truth)


def test_the_noise_differs_between_images_and_starts_again_after_a_reset(registration, capture):
    perceive = GroundTruthPerceiver(registration, (1,))
    first = [perceive(capture) for _ in range(IMAGES)]
    perceive.reset()
    assert [perceive(capture) for _ in range(IMAGES)] == first
    assert len({each.found["needle_tip"].at_mm for each in first}) == IMAGES


def test_the_angle_has_the_noise_of_its_depth(registration, capture):
    perceive = GroundTruthPerceiver(registration, (1,))
    lines = [perceive(capture).found["needle_line"] for _ in range(2000)]
    angles = [angle_between_deg(subtract(line.end_mm, line.start_mm), (0.0, 1.0)) for line in lines]
    assert np.std(angles) == pytest.approx(angle_noise_deg(capture.truth.depth_mm), rel=0.1)


@pytest.mark.parametrize("depth_mm", [0.0, 1.5, 1.7, 3.0, 7.99, 18.0, 30.0])
def test_the_noise_is_interpolated_between_depths(depth_mm):
    assert angle_noise_deg(depth_mm) == pytest.approx(np.interp(depth_mm, NOISE_DEPTHS_MM, NOISE_DEG))
