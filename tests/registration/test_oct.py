"""Registrations of B-scans: their content, and one-sentence errors."""

import numpy as np
import pytest
from helpers import refuse
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.errors import BadInput
from haptigraph.registration.loading import load_registration, parse_registration
from haptigraph.registration.oct import ScanRegistration, check_fits

GOOD = """format = 1

[image]
width = 400
height = 300

[scale]
axial_mm_per_px = 0.0033
lateral_mm_per_px = 0.0078

[target]
depth_share = 0.5
"""


def test_it_defines_the_scale_in_both_directions():
    registration = parse_registration(GOOD, "r.toml")
    assert isinstance(registration, ScanRegistration)
    assert registration.target_share == 0.5
    assert registration.anatomy == {}
    to_mm = registration.image.to_mm
    assert to_mm((199.5, 149.5)) == (0.0, 0.0)
    assert to_mm((299.5, 49.5)) == pytest.approx((0.78, 0.33))


@given(st.floats(0, 400), st.floats(0, 300), st.booleans())
def test_mapping_to_mm_and_back_is_the_identity(x, y, mirrored):
    text = GOOD.replace("height = 300", f"height = 300\nmirrored = {str(mirrored).lower()}")
    image = parse_registration(text, "r.toml").image
    assert image.to_px(image.to_mm((x, y))) == pytest.approx((x, y), abs=1e-6)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("axial_mm_per_px = 0.0033\n", "", "axial_mm_per_px"),
        ("lateral_mm_per_px = 0.0078\n", "", "lateral_mm_per_px"),
        ("axial_mm_per_px = 0.0033", "mm_per_px = 0.0033", "mm_per_px"),
        (
            "0.0033",
            "3.3",
            "line 8: axial_mm_per_px of 3.3 is implausible; scanners have 0.0005 to 0.02 mm",
        ),
        ("0.0078", "0.0", "lateral_mm_per_px of 0 is implausible"),
        ("width = 400", "width = 20", "a width of 20 px is too small; B-scans have at least 64 px"),
        (
            "depth_share = 0.5",
            "depth_share = 1.2",
            "depth_share must be between 0 (ILM) and 1 (RPE), found 1.2",
        ),
        ("format = 1", "format = 7", "unknown format 7"),
    ],
)
def test_an_invalid_file_is_refused_with_its_line(tmp_path, old, new, expected):
    file = tmp_path / "scale.toml"
    file.write_text(GOOD.replace(old, new))
    with pytest.raises(BadInput) as refused:
        load_registration(file)
    assert expected in str(refused.value)
    assert str(file) in str(refused.value)


def test_a_perceiver_refuses_registrations_of_the_other_kind(quick_uri, quick_scan, tmp_path):
    message = refuse("run", quick_uri, "--fast", "--set", "perception.perceiver=bscan")
    assert "perceiver bscan needs the scale of B-scans" in message
    message = refuse("run", f"phantom:{quick_scan}", "--fast")
    assert "this registration is the scale of B-scans; try --procedure subretinal_injection_ioct" in message
    message = refuse("run", f"phantom:{quick_scan}", "--fast", "--set", "source.target_mm=1.0")
    assert "source.target_mm does not apply to B-scan scenarios" in message


def test_a_run_without_a_scale_is_refused(quick_scan, tmp_path):
    file = tmp_path / "scale.toml"
    file.write_text(GOOD.replace("lateral_mm_per_px = 0.0078\n", ""))
    message = refuse(
        *("run", f"phantom:{quick_scan}", "--fast", "--procedure", "subretinal_injection_ioct"),
        *("--registration", file),
    )
    assert "lateral_mm_per_px" in message
    assert str(file) in message


# --- volumes

VOLUME = GOOD.replace("[target]", "[volume]\nslices = 20\nslice_mm = 0.05\n\n[target]")


def test_a_volume_is_registered_as_its_b_scans_side_by_side():
    registration = parse_registration(VOLUME, "r.toml")
    assert (registration.width_px, registration.height_px) == (20 * 400, 300)
    assert registration.voxel_mm == (0.0033, 0.05, 0.0078)
    volume = np.arange(300 * 20 * 400, dtype=np.uint32).astype(np.uint8).reshape(300, 20, 400)
    side_by_side = np.concatenate([volume[:, number] for number in range(20)], axis=1)
    assert np.array_equal(registration.checked_volume(side_by_side), volume)
    assert np.shares_memory(registration.checked_volume(side_by_side), side_by_side)


def test_a_place_in_a_volume_is_in_the_nearest_b_scan():
    image = parse_registration(VOLUME, "r.toml").image
    x_px, y_px = parse_registration(GOOD, "r.toml").image.to_px((0.2, 0.1))
    assert image.to_px((0.2, 0.1), 0.025) == (10 * 400 + x_px, y_px)
    assert image.to_px((0.2, 0.1), -9.0) == (x_px, y_px)
    assert image.slices.z_mm(0) == pytest.approx(-0.475)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (("slices = 20", "slices = 2"), "volumes have at least 4"),
        (("slice_mm = 0.05", "slice_mm = 5"), "slice_mm of 5 is implausible"),
        (("width = 400", "width = 9"), "B-scans of a volume have at least 16 px"),
        (("slices = 20\n", ""), "missing"),
    ],
)
def test_an_invalid_volume_is_rejected(change, problem):
    with pytest.raises(BadInput, match=problem):
        parse_registration(VOLUME.replace(*change), "r.toml")


def test_a_single_b_scan_is_no_volume():
    with pytest.raises(BadInput, match=r"image is 400 x 300 px, but the registration is for 8000 x 300 px"):
        parse_registration(VOLUME, "r.toml").checked_volume(np.zeros((300, 400), np.uint8))


@pytest.mark.parametrize(
    ("text", "images", "problem"),
    [
        (VOLUME, "bscan", "does not process volumes, and this registration has"),
        (VOLUME, "eye", "does not process volumes"),
        (GOOD, "volume", "needs volumes, a registration with"),
        (GOOD, "eye", "needs an eye before a camera"),
    ],
)
def test_a_perceiver_for_other_images_is_refused(text, images, problem):
    registration = parse_registration(text, "r.toml")
    with pytest.raises(BadInput, match=problem):
        check_fits("mine", images, registration)
