"""The simulated depth camera: geometry, noise, holes, and the shaft that the image shows."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from paths import DATA

from haptigraph.errors import BadInput
from haptigraph.registration.depth import DepthGeometry
from haptigraph.sim.eye.depth import DepthRenderer, DepthShape, needle_in_space
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.optics import image_geometry
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario

SCENARIO = load_scenario(str(DATA / "deep.toml"))
EYE, CAMERA, NEEDLE = Eye(SCENARIO.eye), SCENARIO.camera, SCENARIO.needle
EXACT = DepthShape(subpixel_px=0.0, missing_share=0.0, shaft_missing_share=0.0, unit_mm=0.01)
TIP_MM = 2.0, -4.0


def renderer(shape, **camera):
    settings = replace(CAMERA, **camera)
    return DepthRenderer(EYE, settings, NEEDLE, shape, image_geometry(settings), 3)


def at(depth, px):
    """The depth at a pixel of the whole image [mm]."""
    return depth.values[round(px[1]) - depth.top_px, round(px[0]) - depth.left_px] * depth.unit_mm


def test_bowl_wall_and_what_is_behind_have_their_depths():
    depth, to_px = renderer(EXACT).render(None, 0), image_geometry(CAMERA).to_px
    assert at(depth, to_px((0.0, 0.0))) == pytest.approx(CAMERA.distance_mm + 12, abs=0.1)
    assert at(depth, to_px((12.8, 0.0))) == pytest.approx(CAMERA.distance_mm, abs=0.1)
    assert at(depth, to_px((0.0, 18.0))) == pytest.approx(CAMERA.distance_mm + 25, abs=0.2)


@given(st.floats(-40, 40), st.floats(-8, 8), st.floats(-8, 8))
def test_the_shaft_leans_as_stated_and_appears_where_it_is_drawn(tilt_deg, x_mm, y_mm):
    needle = replace(NEEDLE, tilt_deg=tilt_deg)
    shaft = needle_in_space((x_mm, y_mm), EYE, needle, CAMERA)
    right, up, towards = shaft.along_mm
    assert math.degrees(math.atan2(towards, math.hypot(right, up))) == pytest.approx(tilt_deg, abs=0.02)
    geometry = DepthGeometry(image_geometry(CAMERA), renderer(EXACT).plane)
    at_px = np.array([image_geometry(CAMERA).to_px((x_mm, y_mm))])
    (tip,) = geometry.to_eye_mm(at_px, np.array([CAMERA.distance_mm - shaft.end_z_mm]))
    assert tip == pytest.approx([*shaft.end_mm, shaft.end_z_mm], abs=0.01)


def test_the_shaft_is_before_its_axis_by_up_to_its_radius():
    shaft = needle_in_space(TIP_MM, EYE, NEEDLE, CAMERA)
    depth = renderer(replace(EXACT, edge_px=0.0)).render(shaft, 0)
    share = 0.5  # of the way from the trocar to the tip, where the needle has its full width
    start, end = np.array([*shaft.start_mm, 0.0]), np.array([*shaft.end_mm, shaft.end_z_mm])
    x, y, z = start + share * (end - start)
    foot = image_geometry(CAMERA).to_mm(((CAMERA.width_px - 1) / 2, (CAMERA.height_px - 1) / 2))
    apparent = np.array(foot) + (np.array([x, y]) - foot) / (1 - z / CAMERA.distance_mm)
    before_mm = CAMERA.distance_mm - z - at(depth, image_geometry(CAMERA).to_px(tuple(apparent)))
    assert 0.2 < before_mm <= NEEDLE.diameter_mm / 2 + 0.03


def test_the_noise_of_disparities_has_the_stated_deviation():
    shape = replace(EXACT, subpixel_px=0.3)
    exact, noisy = renderer(EXACT).render(None, 0), renderer(shape).render(None, 0)
    disparities = [shape.disparity_px_mm / (image.values * image.unit_mm) for image in (exact, noisy)]
    assert np.std(disparities[1] - disparities[0]) == pytest.approx(0.3, rel=0.05)


def test_an_image_number_always_gives_the_same_depths():
    shape = DepthShape()
    first, again, other = (renderer(shape).render(None, number).values for number in (4, 4, 5))
    assert (first == again).all()
    assert (first != other).any()


def test_shares_of_pixels_have_no_depth():
    values = renderer(DepthShape(missing_share=0.2)).render(None, 0).values
    assert (values == 0).mean() == pytest.approx(0.2, abs=0.02)


def test_a_camera_that_sees_all_too_far_registers_the_section_too_far():
    far = renderer(DepthShape(scale_error=0.02))
    assert far.plane.section_mm == pytest.approx(1.02 * CAMERA.distance_mm)
    assert at(far.render(None, 0), CAMERA.center_px) == pytest.approx(
        1.02 * (CAMERA.distance_mm + 12), rel=0.01
    )


def test_a_phantom_without_depth_has_none():
    phantom = Phantom(replace(SCENARIO, depth=None))
    assert phantom.depth_camera is None
    moment = phantom.advance()
    assert moment.depth is None
    assert "needle_3d" not in moment.truth.others
    assert "[depth]" not in phantom.registration


def test_settings_out_of_range_are_refused(tmp_path):
    text = (DATA / "deep.toml").read_text().replace("[depth]", "[depth]\nmissing_share = 1.5")
    (tmp_path / "bad.toml").write_text(text)
    with pytest.raises(BadInput, match=r"depth\.missing_share"):
        load_scenario(str(tmp_path / "bad.toml"))
