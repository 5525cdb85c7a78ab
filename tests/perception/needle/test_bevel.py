import math

import cv2
import numpy as np
import pytest
from drawn_strip import draw_rim
from helpers import mostly_slow

from haptigraph.config import PerceptionConfig
from haptigraph.geometry import subtract
from haptigraph.messages import Capture
from haptigraph.perception.needle.rectify import EyeGeometry, Line
from haptigraph.perception.needle.tracker import Tracker
from haptigraph.projection import ImageGeometry
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.eye.eye import Eye, EyeShape, registration_text

GEOMETRY = ImageGeometry(center_px=(320.0, 190.0), mm_per_px=1 / 14, mirrored=True)
REGISTRATION = parse_registration(registration_text(Eye(EyeShape()), GEOMETRY, 640, 400), "test")
EYE = EyeGeometry(REGISTRATION)
LINE = Line(EYE.inwards_rad + 0.1, 0.0)
WIDTH_PX, GROUND = 12.0, 120.0
BEVEL_PX = 25.0  # how long it is
DEPTHS_PX = np.linspace(40.0, 160.0, 30)


def drawn(tip_px, side, grey, uneven=0.0, shadow=0.0):
    """A needle whose end is cut so that its tip is on one side; 0 for a blunt end."""
    y, x = np.mgrid[:400, :640]
    (x0, y0), (dx, dy) = LINE.at_px(EYE.trocar_px, 0.0), LINE.direction
    along, across = (x - x0) * dx + (y - y0) * dy, (y - y0) * dx - (x - x0) * dy
    cut_px = np.clip(WIDTH_PX / 2 - side * across, 0, WIDTH_PX) / WIDTH_PX * BEVEL_PX if side else 0.0
    covered = np.clip(WIDTH_PX / 2 + 0.5 - abs(across), 0, 1) * np.clip(tip_px - cut_px + 0.5 - along, 0, 1)
    lit = grey * (1 + uneven * 2 * across / WIDTH_PX)
    beside = np.exp(-0.5 * ((across - 9) / 5) ** 2) * np.clip((tip_px + 6 - along) / 6, 0, 1)
    image = GROUND * (1 - shadow * beside) * (1 - covered) + lit * covered
    image = cv2.GaussianBlur(draw_rim(image, EYE), (0, 0), 0.8)
    noise = np.random.default_rng(round(1000 * tip_px)).normal(0, 1.5, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def follow(tracker, images):
    background = draw_rim(np.full((400, 640), round(GROUND), np.uint8), EYE)
    captures = [Capture(n, round(n * 1e9 / 30), image) for n, image in enumerate([background, *images])]
    return [tracker(capture) for capture in captures][-1]


def off_axis_px(observation):
    """How far off the shaft's axis the reported tip is."""
    found = observation.found
    away = subtract(GEOMETRY.to_px(found["needle_tip"].at_mm), GEOMETRY.to_px(found["needle_line"].end_mm))
    return away[0] * LINE.normal[0] + away[1] * LINE.normal[1]


@pytest.fixture
def tracker():
    return Tracker(REGISTRATION, PerceptionConfig())


@pytest.mark.parametrize("side", mostly_slow([-1, 1], 1))
@pytest.mark.parametrize("grey", [40.0, 210.0])
def test_reports_the_tip_of_a_bevel_off_the_axis_and_the_shaft_on_it(tracker, side, grey):
    observation = follow(tracker, [drawn(tip_px, side, grey) for tip_px in DEPTHS_PX])
    assert off_axis_px(observation) == pytest.approx(side * WIDTH_PX / 2, abs=1.8)
    tip_px = GEOMETRY.to_px(observation.found["needle_tip"].at_mm)
    assert math.dist(tip_px, LINE.at_px(EYE.trocar_px, DEPTHS_PX[-1])) == pytest.approx(WIDTH_PX / 2, abs=1.8)
    shaft = observation.found["needle_line"]
    (x0, y0), (x1, y1) = GEOMETRY.to_px(shaft.start_mm), GEOMETRY.to_px(shaft.end_mm)
    assert math.degrees(math.atan2(y1 - y0, x1 - x0) - LINE.angle_rad) == pytest.approx(0, abs=0.3)


@pytest.mark.parametrize("uneven", mostly_slow([-0.6, 0.0, 0.6], 0.6))
@pytest.mark.parametrize("grey", [60.0, 190.0])
def test_reports_a_blunt_end_lit_from_one_side_on_the_axis(tracker, uneven, grey):
    observation = follow(tracker, [drawn(tip_px, 0, grey, uneven) for tip_px in DEPTHS_PX])
    assert off_axis_px(observation) == pytest.approx(0, abs=0.01)


def test_a_shadow_beside_a_tip_does_not_shift_it(tracker):
    observation = follow(tracker, [drawn(tip_px, 0, 190.0, shadow=0.25) for tip_px in DEPTHS_PX])
    assert off_axis_px(observation) == pytest.approx(0, abs=0.01)


def test_forgets_the_bevel_of_the_last_needle(tracker):
    follow(tracker, [drawn(tip_px, 1, 40.0) for tip_px in DEPTHS_PX])
    observation = follow(tracker, [drawn(tip_px, 0, 40.0) for tip_px in DEPTHS_PX[:3]])
    assert off_axis_px(observation) == pytest.approx(0, abs=0.01)


def test_images_that_disagree_show_no_bevel(tracker):
    sides = [1 if number % 2 else -1 for number in range(len(DEPTHS_PX))]
    images = [drawn(tip_px, side, 40.0) for tip_px, side in zip(DEPTHS_PX, sides, strict=True)]
    assert off_axis_px(follow(tracker, images)) == pytest.approx(0, abs=0.01)
