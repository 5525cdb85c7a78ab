"""Loading a registration of either kind."""

import pytest
from paths import DATA

import haptigraph
from haptigraph.errors import BadInput
from haptigraph.registration.camera import Registration
from haptigraph.registration.loading import (
    load_camera_registration,
    load_registration,
    parse_camera_registration,
    parse_registration,
)
from haptigraph.registration.oct import ScanRegistration
from haptigraph.registration.text import scan_registration_text

SCAN = scan_registration_text((400, 300), 0.0033, 0.0078, "Scale of a scanner.", depth_share=0.5)


def test_a_registration_of_an_eye_is_a_camera_registration(registration_toml, tmp_path):
    file = tmp_path / "eye.toml"
    file.write_text(registration_toml)
    registration = load_registration(file)
    assert isinstance(registration, Registration)
    assert registration == load_camera_registration(file) == parse_registration(registration_toml, "text")


def test_a_registration_with_a_scale_is_a_scan_registration(tmp_path):
    file = tmp_path / "scale.toml"
    file.write_text(SCAN)
    registration = load_registration(file)
    assert isinstance(registration, ScanRegistration)
    assert registration == parse_registration(SCAN, "text")
    assert (registration.width_px, registration.height_px, registration.target_share) == (400, 300, 0.5)
    assert registration.image.axial_mm_per_px == pytest.approx(0.0033)


def test_a_camera_registration_is_not_read_from_b_scans():
    with pytest.raises(BadInput, match=r"scale\.toml.*: unknown key 'scale'"):
        parse_camera_registration(SCAN, "scale.toml")


def test_the_package_loads_either_kind(tmp_path):
    file = tmp_path / "scale.toml"
    file.write_text(SCAN)
    assert isinstance(haptigraph.load_registration(file), ScanRegistration)
    registration = haptigraph.load_registration(DATA / "v0_1" / "registration.toml")
    assert isinstance(registration, Registration)
    assert registration.background.is_known.all()  # of 0.1.0, with its reference image


@pytest.mark.parametrize("text", ["[scale", "format = 1", "format = 1\n[scale]\n"])
def test_errors_name_the_file(tmp_path, text):
    file = tmp_path / "bad.toml"
    file.write_text(text)
    with pytest.raises(BadInput, match=r"bad\.toml"):
        load_registration(file)
    with pytest.raises(BadInput, match=r"gone\.toml: cannot be read"):
        load_registration(tmp_path / "gone.toml")
