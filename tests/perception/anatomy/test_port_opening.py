"""Mouths of holes against the simulator's truth."""

import cv2
import numpy as np
import pytest
from msgspec.structs import replace

from haptigraph.perception.anatomy.anatomy import find_anatomy
from haptigraph.perception.anatomy.port_opening import find_port_openings
from haptigraph.perception.anatomy.rim import find_rim
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario


def still(style: str, rim_mm: float, distance_mm: float):
    scenario = load_scenario("align_then_approach")
    phantom = Phantom(
        replace(
            scenario,
            eye=replace(scenario.eye, rim_mm=rim_mm),
            camera=replace(scenario.camera, distance_mm=distance_mm),
            appearance=replace(scenario.appearance, style=style),
        )
    )
    moment = phantom.advance()
    assert moment is not None
    return moment.image


@pytest.mark.parametrize("style", ["light", "dark"])
def test_mouths_seen_whole_tell_where_the_rim_stands(style):
    found = find_anatomy([still(style, 1.0, 60.0)])
    assert found.rim_by == ("mouths",)
    assert found.rim_ratio == pytest.approx(60 / 59, abs=0.004)
    assert found.radius_px == pytest.approx(240, abs=1.0)
    assert found.rim_uncertainty_px < 1.0


def test_mouths_at_the_edge_tell_angles_only():
    image = still("dark", 0.0, 250.0)
    mouths = find_port_openings(image, find_rim(image).inner)
    assert sorted(mouth.angle_deg for mouth in mouths) == pytest.approx([-36, 36], abs=1)
    assert [mouth.inside_px for mouth in mouths] == [None, None]
    found = find_anatomy([image])
    assert found.rim_ratio == 1
    assert found.rim_uncertainty_px > 3  # and that is told


def test_a_reflection_is_no_hole():
    image = still("dark", 0.0, 250.0)
    spot = cv2.ellipse(np.zeros(image.shape[:2], np.uint8), (640, 168), (8, 4), 0, 0, 360, 255, -1)
    image[spot > 0] = 255
    mouths = find_port_openings(image, find_rim(image).inner)
    assert sorted(mouth.angle_deg for mouth in mouths) == pytest.approx([-36, 36], abs=1)
