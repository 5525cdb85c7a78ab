import cv2
import numpy as np
import pytest
from helpers import call

from haptigraph.registration.loading import load_registration, parse_registration
from haptigraph.sim.oct.phantom import open_phantom
from haptigraph.sim.oct.scenes import random_scene

SCALE = ("--set", "source.axial_mm_per_px=0.0033", "--set", "source.lateral_mm_per_px=0.0078")


@pytest.fixture(scope="module")
def monitor(tmp_path_factory):
    """Two screenshots of a monitor with a B-scan of 512 x 512 px, and its true scale."""
    folder = tmp_path_factory.mktemp("monitor")
    scene = random_scene(0, 4, place="none")
    for number in range(2):
        screen = np.full((600, 700), 30, np.uint8)
        screen[40:552, 90:602] = scene.take(number=number).image
        cv2.imwrite(str(folder / f"{number}.png"), screen)
    scan = scene.scan
    return folder, scan.axial_mm_per_px, scan.lateral_mm_per_px


def given_scale(axial_mm, lateral_mm):
    return (
        *("--set", f"source.axial_mm_per_px={axial_mm}", "--set", f"source.lateral_mm_per_px={lateral_mm}"),
        *("--set", "source.crop_px=[90, 40, 512, 512]"),
    )


def test_scale_and_crop_are_reported_drawn_and_written(monitor, tmp_path):
    folder, axial_mm, lateral_mm = monitor
    output = tmp_path / "scan.toml"
    result = call("register", f"oct:{folder}", "-o", str(output), *given_scale(axial_mm, lateral_mm))
    assert result.exit_code == 0, result.output
    assert "512 x 512 px, cropped from (90, 40) px of each image; 2 examined" in result.output
    assert (
        f"axial      {axial_mm:.6g} mm/px, as given: {512 * axial_mm:.2f} mm from top to bottom"
        in result.output
    )
    assert "ILM and RPE are 0." in result.output
    registration = load_registration(output)
    assert (registration.width_px, registration.height_px) == (512, 512)
    assert registration.image.axial_mm_per_px == pytest.approx(axial_mm)
    assert registration.image.mm_per_px == pytest.approx(lateral_mm)
    picture = cv2.imread(str(output.with_suffix(".png")))
    assert picture.shape[0] >= 512
    assert picture.shape[1] > 2 * 512  # as stored, and in true proportions


def test_volumes_are_registered_with_the_distance_of_their_b_scans(quick_volume, tmp_path):
    phantom, folder = open_phantom(quick_volume), tmp_path / "volumes"
    folder.mkdir()
    registration = parse_registration(phantom.registration, "phantom")
    for number in range(2):
        volume = registration.checked_volume(phantom.advance().image)
        np.save(folder / f"{number}.npy", volume)
    sizes = ("axial_mm_per_px", 0.0077), ("lateral_mm_per_px", 0.0135), ("slice_mm", 0.05)
    settings = [word for key, size in sizes for word in ("--set", f"source.{key}={size}")]
    axes = "--set", 'source.volume_axes="rows,slices,columns"'
    output = tmp_path / "volumes.toml"
    result = call("register", f"oct:{folder}", "-o", str(output), *settings, *axes)
    assert result.exit_code == 0, result.output
    assert "volumes    128 x 192 px, 32 B-scans each; 2 examined" in result.output
    assert "slices     0.05 mm/px, as given: 1.60 mm from the first to the last" in result.output
    assert "1.73 mm across" in result.output
    assert load_registration(output).voxel_mm == pytest.approx(registration.voxel_mm)
    picture = cv2.imread(str(output.with_suffix(".png")))
    assert picture.shape[1] > 128 + (1.73 + 1.6) / 0.0077


def refused(tmp_path, *arguments):
    output = tmp_path / "scan.toml"
    result = call("register", *arguments, "-o", str(output))
    assert result.exit_code == 2
    assert list(tmp_path.iterdir()) == []
    return result.output


def test_invalid_scale_or_crop_is_refused_and_no_file_written(monitor, tmp_path):
    folder, axial_mm, lateral_mm = monitor
    assert "states no axial scale" in refused(tmp_path, f"oct:{folder}")
    assert "0.0005 to" in refused(tmp_path, f"oct:{folder}", *given_scale(1000 * axial_mm, lateral_mm))
    outside = "--set", "source.crop_px=[400, 40, 512, 512]"
    assert "but the image is 700 x 600 px" in refused(tmp_path, f"oct:{folder}", *SCALE, *outside)
    blank = "--set", "source.crop_px=[0, 0, 80, 600]"
    assert "its B-scans are empty" in refused(tmp_path, f"oct:{folder}", *SCALE, *blank)


def test_images_of_an_eye_before_a_camera_take_no_settings(monitor, tmp_path):
    assert "--set is for B-scans" in refused(tmp_path, str(monitor[0]), *SCALE)
