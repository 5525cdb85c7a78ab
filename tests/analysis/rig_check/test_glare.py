"""Glare at a port opening, and the shaft of an instrument there, which is none."""

import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from rig_setups import SABOTAGES, simulated_setup

from haptigraph.analysis.rig_check.clip import clip_of
from haptigraph.analysis.rig_check.glare import glare
from haptigraph.analysis.rig_check.view import view_of
from haptigraph.messages import Capture

SEED = 9103
GLARE = SABOTAGES["glare on the port"][0]


@pytest.fixture(scope="module")
def sound():
    return simulated_setup(0, SEED, has_mark=False, has_reference=False)


def found(setup):
    captures = [Capture(number, number * 33_000_000, image) for number, image in enumerate(setup.images[:9])]
    return glare(view_of(clip_of(captures, setup.registration, 30.0), setup.registration)).findings


def with_white_shaft(setup, turn_deg, length_mm=8.0):
    """A saturated shaft of 0.9 mm through the used port, at an angle to the radius."""
    registration = setup.registration
    trocar_mm, turn = np.array(registration.trocar.at_mm), np.radians(turn_deg)
    inwards = -trocar_mm / np.linalg.norm(trocar_mm)
    along = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ inwards
    ends = [registration.image.to_px(tuple(trocar_mm + at_mm * along)) for at_mm in (-5.0, length_mm)]
    corners = [tuple(np.rint(np.array(end) * 16).astype(int).tolist()) for end in ends]
    width_px = round(0.9 * setup.px_per_mm)
    images = tuple(
        np.asarray(cv2.line(image.copy(), *corners, (255, 255, 255), width_px, cv2.LINE_AA, 4))
        for image in setup.images[:9]
    )
    return replace(setup, images=images)


@pytest.mark.parametrize("turn_deg", [-35.0, 0.0, 25.0])
def test_a_saturated_shaft_is_no_glare(sound, turn_deg):
    assert found(with_white_shaft(sound, turn_deg)) == ()


@pytest.mark.parametrize("severity", [1, 2])
def test_glare_beside_a_saturated_shaft_is_found(sound, severity):
    shafted = with_white_shaft(sound, 10.0)
    assert [each.name for each in found(GLARE(shafted, severity, np.random.default_rng(0)))] == ["glare"]


def test_a_white_streak_that_ends_at_the_opening_is_glare(sound):
    assert [each.name for each in found(with_white_shaft(sound, 0.0, length_mm=2.2))] == ["glare"]
