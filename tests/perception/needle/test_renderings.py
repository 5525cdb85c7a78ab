"""The tracker on six scenes that `make render` has rendered.

Bounds, not figures: docs/explanation/accuracy_results.md states the results. Metal mirrors its surroundings here; simulated needles
do not.
"""

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers import mostly_slow
from paths import RENDERINGS

from haptigraph.analysis.evaluation.evaluation import evaluate_clip
from haptigraph.analysis.registering.registering import all_images
from haptigraph.config import load_config

BOUNDS = {  # tip px p50, p95, angle p95 in degrees at 1 to 3 mm and beyond
    "black_round": (0.25, 0.9, 0.1, 0.15),
    "dark_bowl_bevel": (1.7, 2.8, 0.4, 0.2),
    "dark_bowl_long": (0.4, 0.95, 0.15, 0.15),
    "golden_thin": (0.45, 2.6, 0.1, 0.1),
    "orange_bowl": (2.3, 11.0, 0.35, 0.25),
    "second_instrument": (0.8, 3.6, 0.2, 0.3),
}
FAINT = {"orange_bowl": 0.8}  # share of the images in which the tip is known, where its point is faint


def test_every_rendering_has_its_bounds():
    assert {folder.name for folder in RENDERINGS.iterdir()} == set(BOUNDS)


@pytest.mark.parametrize("name", BOUNDS)
def test_locates_a_rendered_needle(name):
    scores = evaluate_clip(RENDERINGS / name, load_config()).scores
    tip_px, angle_deg = scores["tip_error_px"], scores["angle_error_deg"]
    assert scores["detection_rate"] == 1
    assert scores["tip_known_rate"] >= FAINT.get(name, 1)
    assert scores["false_detections"] == 0
    assert scores["wrong_contact_images"] == 0
    assert scores["state_agreement"] >= min(FAINT.get(name, 1), 0.96)
    errors = tip_px["median"], tip_px["p95"], angle_deg["shallow"]["p95"], angle_deg["deep"]["p95"]
    assert all(error <= bound for error, bound in zip(errors, BOUNDS[name], strict=True)), errors


def dim(image: np.ndarray, number: int) -> np.ndarray:
    return 0.45 * image


def noisy(image: np.ndarray, number: int) -> np.ndarray:
    return image + np.random.default_rng(number).normal(0, 7, image.shape[:2])[..., None]


def flickering(image: np.ndarray, number: int) -> np.ndarray:
    return image * (1 + 0.12 * np.sin(1.3 * number))


def with_beads(image: np.ndarray, number: int) -> np.ndarray:
    """Black beads and bright bubbles that drift in front of the needle."""
    height, width = image.shape[:2]
    for bead in range(6):
        turn = 2.4 * bead + 0.04 * number
        x, y = width * (0.5 + 0.2 * np.sin(turn)), height * (0.55 + 0.25 * np.cos(1.7 * turn))
        grey, thickness = ((230,) * 3, 2) if bead % 2 else ((20,) * 3, cv2.FILLED)
        cv2.circle(
            image, (round(16 * x), round(16 * y)), 16 * (5 + bead // 2), grey, thickness, cv2.LINE_AA, 4
        )
    return image


def defocused(image: np.ndarray, number: int) -> np.ndarray:
    return cv2.GaussianBlur(image, (0, 0), 1.3)


DEGRADED = {dim: 1.2, noisy: 0.6, flickering: 0.5, with_beads: 0.6}  # tip px p50


def degrade(folder: Path, degraded: Path, how: Callable[[np.ndarray, int], np.ndarray]) -> Path:
    shutil.copytree(folder, degraded, ignore=shutil.ignore_patterns("clip.mp4"))
    writer = None
    for number, image in enumerate(all_images(str(folder / "clip.mp4"))):
        if writer is None:
            size_px = image.shape[1::-1]
            writer = cv2.VideoWriter(str(degraded / "clip.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 30, size_px)
        writer.write(np.clip(np.rint(how(image.astype(np.float32), number)), 0, 255).astype(np.uint8))
    writer.release()
    return degraded


@pytest.mark.parametrize("name", ["black_round", pytest.param("dark_bowl_long", marks=pytest.mark.slow)])
@pytest.mark.parametrize("how", mostly_slow(DEGRADED, noisy, with_beads), ids=lambda how: how.__name__)
def test_locates_a_rendered_needle_in_degraded_images(how, name, tmp_path):
    scores = evaluate_clip(degrade(RENDERINGS / name, tmp_path / name, how), load_config()).scores
    assert scores["detection_rate"] == 1
    assert scores["tip_known_rate"] >= FAINT.get(name, 1)
    assert scores["false_detections"] == 0
    assert scores["wrong_contact_images"] == 0
    assert scores["state_agreement"] >= min(FAINT.get(name, 1), 0.96)
    assert scores["tip_error_px"]["median"] <= DEGRADED[how]


def test_a_hard_shadow_out_of_focus_is_no_needle(tmp_path):
    scores = evaluate_clip(
        degrade(RENDERINGS / "black_round", tmp_path / "defocused", defocused), load_config()
    ).scores
    assert scores["state_agreement"] >= 0.96
    assert scores["tip_error_px"]["p95"] <= 1.3
