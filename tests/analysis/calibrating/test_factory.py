"""The manufacturer's calibration, from the SDK's intrinsics and its software device."""

from types import SimpleNamespace

import numpy as np
import pytest

from haptigraph.analysis.calibrating import calibrating
from haptigraph.analysis.calibrating.calibrating import read_factory_lens
from haptigraph.analysis.calibrating.factory import lens_of
from haptigraph.errors import BadInput
from haptigraph.registration.lens_file import load_lens


def intrinsics(model: str, coeffs: list) -> SimpleNamespace:
    return SimpleNamespace(
        width=1280,
        height=720,
        fx=675.0,
        fy=674.5,
        ppx=641.0,
        ppy=355.0,
        model=SimpleNamespace(name=model),
        coeffs=coeffs,
    )


def test_brown_and_conradys_coefficients_are_taken_as_they_are():
    lens = lens_of(intrinsics("brown_conrady", [-0.05, 0.06, 1e-4, -2e-4, -0.02]))
    assert lens.focal_px == (675.0, 674.5) and lens.principal_px == (641.0, 355.0)
    assert lens.distortion == (-0.05, 0.06, 1e-4, -2e-4, -0.02) and lens.sd_px is None


def test_the_inverse_model_is_converted():
    coeffs = [0.03, -0.02, 4e-4, -3e-4, 0.003]
    lens = lens_of(intrinsics("inverse_brown_conrady", coeffs))
    for at_px in ((20.0, 30.0), (641.0, 355.0), (1200.0, 650.0)):
        x, y = (at_px[0] - 641.0) / 675.0, (at_px[1] - 355.0) / 674.5
        r2 = x * x + y * y  # as rs2_deproject_pixel_to_point has it
        radial = 1 + coeffs[0] * r2 + coeffs[1] * r2**2 + coeffs[4] * r2**3
        ideal_x = x * radial + 2 * coeffs[2] * x * y + coeffs[3] * (r2 + 2 * x * x)
        ideal_y = y * radial + 2 * coeffs[3] * x * y + coeffs[2] * (r2 + 2 * y * y)
        focal = lens.ideal_focal_px
        expected = 641.0 + focal * ideal_x, 355.0 + focal * ideal_y
        assert lens.undistorted(at_px) == pytest.approx(expected, abs=0.06)


def test_other_models_are_refused_unless_they_do_not_distort():
    assert lens_of(intrinsics("ftheta", [0.0] * 5)).distortion == (0.0,) * 5
    with pytest.raises(BadInput, match="reports the lens model ftheta; calibrate with a sheet instead"):
        lens_of(intrinsics("ftheta", [0.1] * 5))


def test_only_realsense_cameras_report_a_calibration(tmp_path):
    with pytest.raises(BadInput, match=r"camera:0 reports no calibration; --factory is for realsense"):
        read_factory_lens("camera:0", tmp_path / "lens.toml", force=False)
    assert not (tmp_path / "lens.toml").exists()


def test_a_recording_of_the_sdk_has_the_calibration_of_its_camera(tmp_path):
    rs = pytest.importorskip("pyrealsense2", reason="needs pyrealsense2 and libusb", exc_type=ImportError)
    from realsense_device import record

    made = rs.intrinsics()
    made.width, made.height, made.fx, made.fy, made.ppx, made.ppy = 128, 96, 70.0, 70.5, 63.0, 47.0
    made.model, made.coeffs = rs.distortion.brown_conrady, [-0.05, 0.06, 0.0, 0.0, 0.0]
    path, output = tmp_path / "run.db3", tmp_path / "lens.toml"
    record(path, [np.zeros((96, 128, 3), np.uint8)] * 3, [0.0, 33.0, 67.0], intrinsics=made)
    report = read_factory_lens(str(path), output, force=False)
    assert "not stated by the manufacturer" in report and str(output) in report
    file = load_lens(output)
    assert (file.image.width, file.image.height) == (128, 96)
    assert file.lens.focal_px == (70.0, 70.5) and file.lens.sd_px is None
    assert file.lens.distortion[:2] == pytest.approx((-0.05, 0.06), abs=1e-6)
    assert calibrating.distortion_text(file.lens, (128, 96)).startswith("-")
