"""The section in depth is found at registration, with its uncertainty, or refused."""

import math
import re

import numpy as np
import pytest
from msgspec.structs import replace
from paths import DATA

from haptigraph.analysis.registering.depth import depth_line, plane_of_face, section_in_depth
from haptigraph.analysis.registering.overrides import Overrides, apply_overrides
from haptigraph.analysis.registering.registering import all_images, plausible_anatomy, spread_images
from haptigraph.errors import BadInput
from haptigraph.messages import DepthImage
from haptigraph.sim.eye.depth import DepthRenderer, DepthShape
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.optics import image_geometry
from haptigraph.sim.scenario import load_scenario

URI = f"phantom:{DATA / 'deep.toml'}"
SCENARIO = load_scenario(str(DATA / "deep.toml"))


@pytest.fixture(scope="module")
def anatomy():
    return plausible_anatomy(spread_images(all_images(URI), URI, 40, None), 24.0, URI)


@pytest.fixture(scope="module")
def found(anatomy):
    return apply_overrides(anatomy, Overrides(diameter_mm=24.0, mirrored=True), 12 / anatomy.radius_px, URI)


def rendered(tilt_deg=(0.0, 0.0), **shape):
    """A depth image of the eye without a needle, and its camera."""
    camera = replace(SCENARIO.camera, tilt_deg=tilt_deg)
    geometry = image_geometry(SCENARIO.camera)
    renderer = DepthRenderer(Eye(SCENARIO.eye), camera, SCENARIO.needle, DepthShape(**shape), geometry, 1)
    return renderer.render(None, 0), renderer.camera


def test_a_source_with_depth_gives_the_section(anatomy, found):
    plane = section_in_depth(URI, anatomy, found)
    assert plane.section_mm == pytest.approx(83.7, abs=3 * plane.section_sd_mm)
    assert abs(plane.section_mm - 83.7) < 0.5
    assert all(abs(angle_deg) < 3 * plane.tilt_sd_deg for angle_deg in plane.tilt_deg)
    assert re.search(r"section at 83\.\d mm \(sd 0\.\d+ mm\)", depth_line(plane, 12 / anatomy.radius_px))


def test_a_source_without_depth_gives_none(quick_uri, anatomy, found):
    assert section_in_depth(quick_uri, anatomy, found) is None


@pytest.mark.parametrize("tilt_deg", [(3.0, 0.0), (-2.0, 4.0)])
def test_a_tilted_face_is_measured(anatomy, found, tilt_deg):
    plane = plane_of_face(*rendered(tilt_deg), anatomy, found)
    for measured, true in zip(plane.tilt_deg, tilt_deg, strict=True):
        assert measured == pytest.approx(true, abs=3 * math.hypot(plane.tilt_sd_deg, 0.05))


def test_depth_that_is_too_large_everywhere_is_reported_against_the_globes_scale(anatomy, found):
    plane = plane_of_face(*rendered(scale_error=0.06), anatomy, found)
    assert "CHECK --diameter-mm" in depth_line(plane, 12 / anatomy.radius_px)
    assert "CHECK" not in depth_line(plane_of_face(*rendered(), anatomy, found), 12 / anatomy.radius_px)


def test_another_globe_than_the_depth_shows_is_refused(anatomy, found):
    with pytest.raises(
        ValueError, match=r"cut face is at 84 mm, but a globe of 34 mm .* check --diameter-mm"
    ):
        plane_of_face(*rendered(), anatomy, replace(found, diameter_mm=34.0))


def test_a_face_without_depth_or_without_a_plane_is_refused(anatomy, found):
    depth, camera = rendered()
    noise = np.random.default_rng(1).integers(500, 3000, depth.values.shape).astype(np.uint16)
    for values in (np.zeros_like(depth.values), noise):
        other = DepthImage(values, depth.unit_mm, depth.left_px, depth.top_px)
        with pytest.raises(ValueError, match="cut face is not visible as a plane"):
            plane_of_face(other, camera, anatomy, found)


def test_the_error_names_the_source(anatomy, found):
    with pytest.raises(BadInput, match=r"deep\.toml: depth: the eye's cut face"):
        section_in_depth(URI, anatomy, replace(found, diameter_mm=34.0))
