"""The optical checks: sound designs pass, and each fault of a design fails its own check."""

import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from haptigraph.cli import main
from haptigraph.rig.description import load_rig, parse_rig
from haptigraph.rig.optics import optical_checks, optics_of
from haptigraph.rig.prediction import predict
from haptigraph.rig.view import View, as_designed

RIGS = sorted((Path(__file__).parents[2] / "rig").glob("*.toml"))
TEXT = next(file for file in RIGS if file.stem == "d405").read_text()


def failing(text: str) -> list[str]:
    checks = optical_checks(predict(parse_rig(text, "rig.toml")))
    return [check.name.split(" of ")[0] for check in checks if not check.is_met]


@pytest.mark.parametrize("file", RIGS, ids=lambda file: file.stem)
def test_the_shipped_rigs_pass(file):
    checks = optical_checks(predict(load_rig(file)))

    assert len(checks) == 5
    assert [check.name for check in checks if not check.is_met] == []


@pytest.mark.parametrize(
    ("old", "new", "check"),
    [
        ("nearest_mm = 70.0", "nearest_mm = 81.0", "distance"),
        ("width_px = 1280\nheight_px = 720", "width_px = 1280\nheight_px = 230", "margin"),
        ("width_px = 1280\nheight_px = 720", "width_px = 640\nheight_px = 480", "radius"),
        ("focus_mm = 100.0", "focus_mm = 400.0", "blur within 1.5 mm"),
        ("to_camera_mm = 45.0", "to_camera_mm = 45.0\nsize_mm = [18.0, 50.0]", "margin"),
        ("to_camera_mm = 45.0", "to_camera_mm = 45.0\nsize_mm = [50.0, 28.0]", "margin"),
    ],
)
def test_each_fault_of_a_design_fails_its_own_check(old, new, check):
    assert old in TEXT
    assert failing(TEXT.replace(old, new)) == [check]


def test_without_a_mirror_none_is_checked():
    direct = TEXT.split("[[mirror]]")[0].replace("[camera]", "direct_mm = 80.0\n[camera]")

    checks = optical_checks(predict(parse_rig(direct, "rig.toml")))

    assert len(checks) == 4 and all("mirror" not in check.name for check in checks)


def test_sharpness_agrees_with_rays_through_the_aperture():
    """Trace the aperture's two edges from a point to the plane of focus, and project them from its middle."""
    rig = load_rig(next(file for file in RIGS if file.stem == "d405"))
    camera = rig.camera
    aperture_mm = camera.focal_px * camera.pixel_um / 1000 / camera.f_number
    at_mm = rig.path_mm - 1.5
    spread_mm = aperture_mm * (camera.focus_mm - at_mm) / at_mm  # of the rays, extended to the plane of focus
    defocus_px = spread_mm / camera.focus_mm * camera.focal_px
    optics = optics_of(rig)

    assert optics.blur_px == pytest.approx(math.hypot(defocus_px, optics.airy_px))
    assert optics.airy_px == pytest.approx(2.44 * 0.55 * 2.0 / 3.0)
    for edge_mm in (rig.path_mm - optics.sharp_from_mm, rig.path_mm + optics.sharp_to_mm):
        spread = aperture_mm * abs(camera.focus_mm - edge_mm) / edge_mm / camera.focus_mm * camera.focal_px
        assert spread == pytest.approx(1.0)


def test_random_rays_from_the_eye_need_no_more_of_the_mirror_than_was_found():
    rig = load_rig(next(file for file in RIGS if file.stem == "d405"))
    view, random = View(rig, as_designed()), np.random.default_rng(5)
    (margin_mm,) = (check.value for check in optical_checks(predict(rig)) if "mirror" in check.name)

    angles, radii = random.uniform(0, 2 * math.pi, 20_000), 13.8 * np.sqrt(random.uniform(0, 1, 20_000))
    eye_mm = np.column_stack(
        [radii * np.cos(angles), radii * np.sin(angles), random.uniform(-5, 0.6, 20_000)]
    )
    rays = view.seen_mm[0] - eye_mm
    share = (35.0 - eye_mm[:, 2] - eye_mm[:, 1]) / (rays[:, 2] + rays[:, 1])  # the mirror: y + z = 35
    hits_mm = eye_mm + share[:, None] * rays
    across_mm, along_mm = hits_mm[:, 0], hits_mm[:, 1] * math.sqrt(2)
    needed_mm = max(np.abs(across_mm).max(), np.abs(along_mm).max())

    assert 25 - needed_mm == pytest.approx(margin_mm, abs=0.6)
    assert 25 - needed_mm >= margin_mm


def test_the_command_prints_the_prediction_and_fails_with_the_optics(tmp_path):
    file = tmp_path / "rig.toml"
    file.write_text(TEXT)
    sound = CliRunner().invoke(main, ["rig", "predict", str(file)])
    file.write_text(TEXT.replace("nearest_mm = 70.0", "nearest_mm = 90.0"))
    near = CliRunner().invoke(main, ["rig", "predict", str(file)])

    assert sound.exit_code == 0, sound.output
    assert "centre (639.5 +- " in sound.output and "below the mirror, its top towards the eye" in sound.output
    assert near.exit_code == 1
    assert "80.0 mm, at least 90 mm: FAILS: the camera works only from there on" in near.output
