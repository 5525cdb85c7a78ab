import math

import cv2
import numpy as np
import pytest
from drawn_strip import GROUND, draw_needle, draw_rim

from haptigraph.config import PerceptionConfig
from haptigraph.messages import Capture
from haptigraph.perception.native.search_grid import CELL, SearchGrid
from haptigraph.perception.needle.rectify import EyeGeometry, Line
from haptigraph.perception.needle.search import MIN_SCORE, PolarSearch
from haptigraph.perception.needle.tracker import OFF_AXIS_MM, Tracker
from haptigraph.projection import ImageGeometry
from haptigraph.registration.camera import Registration
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.eye.eye import Eye, EyeShape, registration_text


def test_finds_nothing_on_a_plain_background(eye):
    assert PolarSearch(eye).search(draw_needle(eye, Line(eye.inwards_rad, 0.0), -900.0)) == []


@pytest.mark.parametrize("turn_deg", [-30.0, -4.0, 11.0, 35.0])
def test_finds_the_angle_of_a_needle(eye, turn_deg):
    true = Line(eye.inwards_rad + math.radians(turn_deg), 0.0)
    found = PolarSearch(eye).search(draw_needle(eye, true, 90.0))
    assert math.degrees(found[0].angle_rad - true.angle_rad) == pytest.approx(0, abs=1.5)


def test_searches_colour_like_grey_and_refuses_another_size(eye):
    image = draw_needle(eye, Line(eye.inwards_rad + 0.1, 0.0), 90.0)
    search = PolarSearch(eye)
    found = search.search(image)
    assert search.search(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)) == found != []
    with pytest.raises(ValueError, match=r"image: expected contiguous uint8 of shape \(240, 320\); found"):
        search.search(image[:, :-1])


def test_counts_bluer_pixels_within_the_globe_alone(eye):
    drawn = draw_needle(eye, Line(eye.inwards_rad + 0.1, 0.0), 90.0).astype(int)
    bluer = (GROUND - drawn) // 4
    image = np.dstack([GROUND + bluer, np.full_like(drawn, GROUND), GROUND - bluer]).clip(0, 255)
    image = image.astype(np.uint8)
    assert PolarSearch(eye).search(image) == []
    assert PolarSearch(eye).search(image, chroma_share=0.4)[0].angle_rad == pytest.approx(
        eye.inwards_rad + 0.1, abs=math.radians(1)
    )


@pytest.fixture
def large() -> Registration:
    """An eye with room for a shaft before it."""
    geometry = ImageGeometry(center_px=(400.0, 420.0), mm_per_px=1 / 16, mirrored=True)
    return parse_registration(registration_text(Eye(EyeShape()), geometry, 800, 640), "large.toml")


@pytest.mark.parametrize("turn_deg", [-25.0, 0.0, 18.0])
@pytest.mark.parametrize("off_axis_mm", [-1.1, -0.5, 0.8])
def test_finds_a_needle_that_points_beside_its_trocar(large, turn_deg, off_axis_mm):
    eye = EyeGeometry(large)
    true = Line(eye.inwards_rad + math.radians(turn_deg), off_axis_mm * eye.px_per_mm)
    search = PolarSearch(eye, OFF_AXIS_MM, until_mm=0.0)
    found = search.search(draw_needle(eye, true, -3.5 * eye.px_per_mm))[0]
    assert math.degrees(found.angle_rad - true.angle_rad) == pytest.approx(0, abs=3)
    assert found.offset_px == pytest.approx(true.offset_px, abs=0.5 * eye.px_per_mm)


@pytest.mark.parametrize("off_axis_mm", [-1.1, 0.8])
def test_detects_a_needle_that_points_beside_its_trocar_in_the_first_image(large, off_axis_mm):
    eye = EyeGeometry(large)
    true = Line(eye.inwards_rad + 0.1, off_axis_mm * eye.px_per_mm)
    depth_px = -3.5 * eye.px_per_mm
    image = draw_rim(draw_needle(eye, true, depth_px), eye)
    observation = Tracker(large, PerceptionConfig())(Capture(0, 0, image))
    tip_px = large.image.to_px(observation.found["needle_tip"].at_mm)
    assert math.dist(tip_px, true.at_px(eye.trocar_px, depth_px)) < 1.5  # an end that is cut square


def test_candidates_are_the_peaks_of_the_scores(eye):
    search, true = PolarSearch(eye), Line(eye.inwards_rad + 0.2, 0.0)
    image = draw_needle(eye, true, 90.0)
    scores = search.scores(image)
    assert scores.shape == (1, len(search.angles_rad))
    assert search.angles_rad[scores[0].argmax()] == search.search(image)[0].angle_rad
    assert scores.max() >= MIN_SCORE
    assert scores.max() == search.scores(image).max()  # a search leaves them as they are


@pytest.mark.parametrize("missing", range(0, 20, 3))
def test_a_line_counts_however_far_from_the_trocar_it_begins_to_show(missing):
    visible = missing + 3
    cells = missing + visible
    image = np.full((3, cells * CELL), 100, np.uint8)
    image[1, missing * CELL :] = 150
    cell = np.arange(3 * cells, dtype=np.int32).reshape(3, cells)
    pixels = np.arange(image.size, dtype=np.int32)
    beside = np.array([cell[[0, 0, 2]], cell[[0, 2, 2]]])
    grid = SearchGrid(
        *(image.shape, pixels, np.ones(image.size, np.bool_), cell.ravel(), pixels.reshape(-1, CELL)),
        *(beside, np.ones((3, cells), np.bool_), 0),
    )
    assert grid.score(image).tolist() == [0, visible - missing, 0]
