"""The section in depth: from pixels with a depth to the eye frame, and its table in the file."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from msgspec.structs import replace
from paths import DATA

from haptigraph.assemble import build
from haptigraph.config import load_config
from haptigraph.errors import BadInput
from haptigraph.projection import ImageGeometry
from haptigraph.registration.camera import anatomy_px
from haptigraph.registration.depth import DepthGeometry, DepthPlane
from haptigraph.registration.loading import parse_camera_registration
from haptigraph.registration.retarget import with_target
from haptigraph.registration.text import registration_text
from haptigraph.registration.tilt import CameraTilt
from haptigraph.sim.phantom import Phantom
from haptigraph.sim.scenario import load_scenario

FOCAL_PX, SECTION_MM = 800.0, 100.0
PLANE = DepthPlane(FOCAL_PX, (320.0, 180.0), 8040.0, SECTION_MM, (0.0, 0.0), 0.1, 0.3)
COORDINATE = st.floats(-10, 10)


def geometry(*, tilt_deg=(0.0, 0.0), mirrored=False, scale=1.0):
    tilt = CameraTilt((300.0, 200.0), tuple(np.radians(tilt_deg)), FOCAL_PX, PLANE.principal_px)
    homography = tilt.frontal_from_image if any(tilt_deg) else None
    image = ImageGeometry((300.0, 200.0), scale * SECTION_MM / FOCAL_PX, mirrored, homography)
    slopes = tilted_slopes(tilt_deg)
    return DepthGeometry(image, replace(PLANE, tilt_deg=slopes)), image


def tilted_slopes(tilt_deg):
    """The slopes of a plane that is turned by an angle about one axis, as (right, down) angles."""
    right, down = np.radians(tilt_deg)
    angle = np.hypot(right, down)
    if angle == 0:
        return 0.0, 0.0
    towards = np.sin(angle) * np.array([right, down]) / angle
    return tuple(np.degrees(np.arctan(towards / np.cos(angle))).tolist())


@given(COORDINATE, COORDINATE, st.booleans())
def test_a_pixel_with_the_sections_depth_is_where_the_image_says(x_mm, y_mm, mirrored):
    depths, image = geometry(mirrored=mirrored)
    (found,) = depths.to_eye_mm(np.array([image.to_px((x_mm, y_mm))]), np.array([SECTION_MM]))
    assert found == pytest.approx([x_mm, y_mm, 0.0], abs=1e-9)


@given(COORDINATE, COORDINATE, st.floats(-15, 15), st.floats(-15, 15), st.booleans())
def test_a_tilted_section_is_the_same_in_depth_and_image(x_mm, y_mm, right_deg, down_deg, mirrored):
    """Each point of the section has the depth at which its ray meets the tilted plane."""
    assume(np.hypot(right_deg, down_deg) > 0.01)
    depths, image = geometry(tilt_deg=(right_deg, down_deg), mirrored=mirrored)
    at_px = np.array([image.to_px((x_mm, y_mm))])
    low, high = 20.0, 500.0
    for _ in range(100):
        middle = (low + high) / 2
        is_before = depths.to_eye_mm(at_px, np.array([middle]))[0, 2] > 0
        low, high = (middle, high) if is_before else (low, middle)
    (found,) = depths.to_eye_mm(at_px, np.array([low]))
    assert found == pytest.approx([x_mm, y_mm, 0.0], abs=1e-6)


@given(st.floats(-5, 5), st.floats(0.95, 1.05))
def test_depths_that_are_all_too_large_by_the_same_share_give_the_same_place(z_mm, share):
    at_px = np.array([[350.0, 150.0]])
    true, _ = geometry()
    depths = DepthGeometry(geometry()[1], replace(PLANE, section_mm=share * SECTION_MM))
    expected = true.to_eye_mm(at_px, np.array([SECTION_MM - z_mm]))
    assert depths.to_eye_mm(at_px, np.array([share * (SECTION_MM - z_mm)])) == pytest.approx(expected)
    assert expected[0, 2] == pytest.approx(z_mm)


def with_depth(registration, **changes):
    focal_px = SECTION_MM / registration.image.mm_per_px
    plane = replace(PLANE, **{"focal_px": focal_px, **changes})
    return registration_text(replace(anatomy_px(registration), depth=plane), "With depth."), plane


def test_a_file_keeps_its_section_in_depth_also_with_another_target(registration):
    text, plane = with_depth(registration)
    again = parse_camera_registration(text, "eye.toml")
    assert again.depth == plane
    assert with_target(again, 2.0).depth == plane


def test_a_file_without_depth_opens_as_before(registration):
    assert registration.depth is None
    assert "depth" not in registration_text(anatomy_px(registration), "Without.")


def test_a_section_at_another_distance_than_the_globes_size_is_refused(registration):
    text, _ = with_depth(registration, section_mm=200.0)
    with pytest.raises(BadInput, match=r"line [0-9]+: at 200 mm a globe .* 2\.00 times as large .*plausible"):
        parse_camera_registration(text, "eye.toml")


def notes_of(uri, tmp_path, text):
    path = tmp_path / "eye.toml"
    path.write_text(text)
    given = f"source.uri={uri}", f"source.registration={path}", "haptics.device=console"
    loop = build(load_config(None, given))
    loop.close()
    return [note for note in loop.notes if "out of the section" in note]


def test_a_run_says_before_it_begins_why_depth_is_of_no_use(tmp_path, quick_uri, registration):
    deep = f"phantom:{DATA / 'deep.toml'}"
    own = Phantom(load_scenario(str(DATA / "deep.toml"))).registration
    anatomy = anatomy_px(parse_camera_registration(own, "deep"))
    (lacks_plane,) = notes_of(deep, tmp_path, registration_text(replace(anatomy, depth=None), "Flat."))
    assert "does not say where the section is in depth; register again with depth" in lacks_plane
    (lacks_depth,) = notes_of(quick_uri, tmp_path, with_depth(registration)[0])
    assert "the source delivers no depth" in lacks_depth
    assert notes_of(deep, tmp_path, own) == []
