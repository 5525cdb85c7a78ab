"""`register --lens`: a registration without the error of the camera's lens."""

import math

import cv2
import numpy as np
from helpers import call
from lens import SECTION, LensScene, lens_scene

from haptigraph.perception.anatomy.camera_tilt import Prior, fit_circles
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


def test_a_simulated_lens_and_a_tilt_are_of_one_camera():
    scene = lens_scene(1, -1, seed=1)
    turns = np.linspace(0, 2 * math.pi, 60, endpoint=False)
    around = scene.radius_mm * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    inner, outer = (
        np.array([scene.lens.undistorted(scene.truth.to_px(tuple(ratio * at_mm))) for at_mm in around])
        for ratio in (1.0, 1.1)
    )
    radius_px = scene.radius_mm / scene.truth.mm_per_px
    closeness = radius_px / scene.lens.ideal_focal_px
    start = np.array([*scene.truth.center_px, radius_px, 0.05, 0.05, closeness, 1.1])

    prior = Prior((closeness, 0.005))
    cost, _ = fit_circles(start, (inner, outer), scene.lens.principal_px, prior)

    assert cost < 1e-3
