"""`register --lens`: a registration without the error of the camera's lens."""

import math

import cv2
from helpers import call
from lens import SECTION, LensScene, lens_scene

from haptigraph.registration.lens_file import LensFile, LensImage, lens_file_text
from haptigraph.registration.loading import load_camera_registration


def largest_error_px(scene: LensScene, registration) -> float:
    """Of the section's points, as the camera sees them and as they are registered."""
    points_mm = [(scene.radius_mm * x, scene.radius_mm * y) for x, y in SECTION]
    errors_mm = [
        math.dist(registration.image.to_mm(scene.truth.to_px(point_mm)), point_mm) for point_mm in points_mm
    ]
    return max(errors_mm) / scene.truth.mm_per_px


def test_with_a_lens_the_registration_is_without_its_distortion(tmp_path):
    scene = lens_scene(2, -1, seed=1)
    source, file, output = (tmp_path / name for name in ("clip.png", "lens.toml", "eye.toml"))
    cv2.imwrite(str(source), scene.image)
    height_px, width_px = scene.image.shape[:2]
    file.write_text(lens_file_text(LensFile(1, LensImage(width_px, height_px), scene.lens)))
    globe = "--diameter-mm", str(2 * scene.radius_mm), "--trocar", "left"
    command = ["register", str(source), "-o", str(output), *globe, "--force"]

    without = call(*command)
    assert without.exit_code == 0, without.output
    distorted_px = largest_error_px(scene, load_camera_registration(output))
    corrected = call(*command, "--lens", str(file))
    assert corrected.exit_code == 0, corrected.output
    registration = load_camera_registration(output)

    assert "lens       corrected as calibrated" in corrected.output
    assert largest_error_px(scene, registration) < 0.5
    assert distorted_px > 1
