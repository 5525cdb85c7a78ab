"""Port openings against the simulator's ground truth."""

from functools import cache

import cv2
import numpy as np
import pytest
from helpers import mostly_slow
from msgspec.structs import replace

from haptigraph.perception.anatomy.anatomy import find_anatomy
from haptigraph.perception.anatomy.port_opening import find_port_openings
from haptigraph.perception.anatomy.rim import find_rim
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario


@cache
def first_image(style: str, rim_mm: float, distance_mm: float):
    scenario = load_scenario("align_then_approach")
    return shown(
        replace(
            scenario,
            eye=replace(scenario.eye, rim_mm=rim_mm),
            camera=replace(scenario.camera, distance_mm=distance_mm),
            appearance=replace(scenario.appearance, style=style),
        )
    )


def shown(scenario):
    moment = Phantom(scenario).advance()
    assert moment is not None
    return moment.image


@pytest.mark.parametrize("style", mostly_slow(["light", "dark"], "dark"))
def test_fully_visible_openings_reveal_a_rim_in_front_of_the_section(style):
    found = find_anatomy([first_image(style, 1.0, 60.0)])
    assert found.rim_evidence == ("port_openings",)
    assert found.rim_ratio == pytest.approx(60 / 59, abs=0.004)
    assert found.radius_px == pytest.approx(240, abs=1.0)
    assert found.rim_uncertainty_px < 1.0


def test_openings_at_the_edge_yield_only_angles():
    image = first_image("dark", 0.0, 250.0)
    openings = find_port_openings(image, find_rim(image).inner)
    assert sorted(opening.angle_deg for opening in openings) == pytest.approx([-36, 36], abs=1)
    assert [opening.inside_px for opening in openings] == [None, None]
    found = find_anatomy([image])
    assert found.rim_ratio == 1
    assert found.rim_uncertainty_px > 3  # without evidence of the rim's position


def test_a_specular_highlight_is_no_port_opening():
    image = first_image("dark", 0.0, 250.0).copy()
    spot = cv2.ellipse(np.zeros(image.shape[:2], np.uint8), (640, 168), (8, 4), 0, 0, 360, 255, -1)
    image[spot > 0] = 255
    openings = find_port_openings(image, find_rim(image).inner)
    assert sorted(opening.angle_deg for opening in openings) == pytest.approx([-36, 36], abs=1)


def test_openings_in_the_mirrored_image_are_at_the_mirrored_angles():
    image = first_image("dark", 0.0, 250.0)
    mirrored = np.ascontiguousarray(image[:, ::-1])

    found, again = (find_port_openings(each, find_rim(each).inner) for each in (image, mirrored))

    assert [-each.angle_deg for each in again] == pytest.approx([each.angle_deg for each in found], abs=0.03)


@pytest.mark.parametrize("noise_grey", mostly_slow([3.0, 9.0], 9.0))
def test_an_opening_that_hardly_shows_is_more_uncertain(noise_grey):
    image = first_image("dark", 0.0, 250.0)
    inner = find_rim(image).inner
    noise = np.random.default_rng(5).normal(0, noise_grey, image.shape)
    pale = np.clip(image / 4 + 100 + cv2.GaussianBlur(noise, (0, 0), 3) * 3, 0, 255).astype(np.uint8)

    clear, faint = (find_port_openings(each, inner) for each in (image, pale))

    assert len(clear) == len(faint) == 2
    for one, other in zip(
        *(sorted(each, key=lambda each: each.angle_deg) for each in (clear, faint)), strict=True
    ):
        assert other.angle_sd_deg > one.angle_sd_deg
        assert abs(other.angle_deg - one.angle_deg) < 3 * other.angle_sd_deg
