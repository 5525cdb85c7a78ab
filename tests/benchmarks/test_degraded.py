import json
import shutil
import subprocess
import sys

import degraded
import numpy as np
import pytest
from msgspec.structs import replace
from paths import ROOT

from haptigraph.analysis.evaluation.ground_truth import TruthRow
from haptigraph.errors import BadInput
from haptigraph.projection import Homography
from haptigraph.registration.background import BackgroundImage
from haptigraph.registration.camera import anatomy_px
from haptigraph.registration.loading import load_camera_registration

CLIP = ROOT / "tests" / "data" / "renderings" / "golden_thin"


def rng():
    return np.random.default_rng(1)


def grey(value, size=(90, 160)):
    return np.full((*size, 3), value, np.uint8)


def spot(at_px, size=(360, 640), sd_px=6.0):
    y, x = np.mgrid[: size[0], : size[1]]
    bright = 250 * np.exp(-((x - at_px[0]) ** 2 + (y - at_px[1]) ** 2) / (2 * sd_px**2))
    return np.dstack([bright.round().astype(np.uint8)] * 3)


def centroid(image):
    weight = image[..., 0].astype(float)
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    return (weight * x).sum() / weight.sum(), (weight * y).sum() / weight.sum()


@pytest.mark.parametrize("at_px", [(200.0, 100.0), (333.25, 211.5), (71.6, 300.9)])
def test_the_truth_scales_with_the_image(at_px):
    image = spot(at_px)
    row = TruthRow(True, True, centroid(image), 9.0, 2.0, "any")
    half = degraded.halved(image, rng())
    assert half.shape == (180, 320, 3)
    assert degraded.halved_truth(row).tip_px == pytest.approx(centroid(half), abs=0.02)
    assert degraded.halved_truth(replace(row, tip_px=None)).tip_px is None
    assert degraded.halved_truth(row) == replace(row, tip_px=degraded.halved_px(row.tip_px))


def test_an_odd_size_loses_its_last_row_and_column():
    assert degraded.halved(grey(9, (91, 161)), rng()).shape == (45, 80, 3)


def test_the_registration_scales_with_the_image():
    full = load_camera_registration(CLIP / "registration.toml")
    half = degraded.halved_registration(full, CLIP)
    assert (half.width_px, half.height_px) == (full.width_px // 2, full.height_px // 2)
    assert half.image.mm_per_px == pytest.approx(2 * full.image.mm_per_px, rel=1e-5)
    for at_mm in ((0.0, 0.0), (5.0, -7.0), full.target.at_mm, full.trocar.at_mm):
        expected = degraded.halved_px(full.image.to_px(at_mm))
        assert half.image.to_px(at_mm) == pytest.approx(expected, abs=2e-3)
    assert half.target.at_mm == pytest.approx(full.target.at_mm, abs=1e-3)
    assert half.trocar.at_mm == pytest.approx(full.trocar.at_mm, abs=1e-3)


def test_homography_and_reference_image_scale_with_the_image():
    frontal_from_image = Homography(((1.053, -0.075, -1.95), (0.007, 0.991, -0.29), (6.3e-5, -9.4e-5, 1.0)))
    half = degraded.halved_homography(frontal_from_image)
    for at_px in ((0.0, 0.0), (640.0, 300.0), (1200.0, 700.0)):
        expected = degraded.halved_px(frontal_from_image(at_px))
        assert half(degraded.halved_px(at_px)) == pytest.approx(expected, abs=1e-6)
    known = np.ones((90, 160), np.bool_)
    known[10, 21] = False
    anatomy = replace(
        anatomy_px(load_camera_registration(CLIP / "registration.toml")),
        background_webp=BackgroundImage(grey(120), known).webp,
    )
    background = BackgroundImage.of_webp(degraded.halved_anatomy(anatomy).background_webp)
    assert background.image.shape == (45, 80, 3)
    assert np.argwhere(~background.is_known).tolist() == [[5, 10]]


def test_noise_has_the_standard_deviation_that_it_says():
    noisy = degraded.noisy(grey(128, (400, 400)), rng())
    noise = noisy.astype(float) - 128
    assert noise.std() == pytest.approx(degraded.NOISE_SD_GREY, rel=0.01)
    assert abs(noise.mean()) < 0.05
    correlation = np.corrcoef(noise.reshape(-1, 3).T)
    assert np.abs(correlation - np.eye(3)).max() < 0.02
    assert np.array_equal(noisy, degraded.noisy(grey(128, (400, 400)), rng()))
    assert degraded.noisy(grey(250), rng()).max() == 255  # it saturates and does not wrap


def test_motion_spreads_a_point_over_nine_pixels_and_shifts_nothing():
    at_px = (320.0, 180.0)
    sharp = spot(at_px, sd_px=2.0)
    blurred = degraded.moved(sharp, rng())
    assert centroid(blurred) == pytest.approx(at_px, abs=0.1)
    y, x = np.mgrid[: sharp.shape[0], : sharp.shape[1]]
    turn = np.radians(degraded.MOTION_DEG)
    along = (x - at_px[0]) * np.cos(turn) + (y - at_px[1]) * np.sin(turn)
    variances = [
        (image[..., 0] * along**2).sum() / image[..., 0].sum(dtype=float) for image in (sharp, blurred)
    ]
    assert variances[1] - variances[0] == pytest.approx(degraded.MOTION_PX**2 / 12, rel=0.15)
    assert np.array_equal(degraded.moved(grey(77), rng()), grey(77))


def test_compression_changes_texture_and_keeps_size_and_brightness():
    image = np.random.default_rng(2).integers(90, 160, (90, 160, 3)).astype(np.uint8)
    compressed = degraded.compressed(image, rng())
    assert compressed.shape == image.shape
    assert compressed.mean() == pytest.approx(image.mean(), abs=1.5)
    assert np.abs(compressed.astype(int) - image).mean() > 5
    assert np.array_equal(degraded.unchanged(image, rng()), image)


def test_every_clip_has_a_row_in_every_variant(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(degraded, "MAX_IMAGES", 14)
    degraded.report([CLIP], tmp_path / "scores.json")
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:2] == ["clip", "variant"]
    names = [line.split()[:2] for line in lines[1:]]
    variants = ["full", "half", "motion", "noise", "jpeg"]
    assert names == [[clip, variant] for clip in ("golden_thin", "all") for variant in variants]
    written = json.loads((tmp_path / "scores.json").read_text())
    assert written["perceiver"] == "tracker"
    assert [[row["clip"], row["variant"]] for row in written["rows"]] == names
    for row in written["rows"]:
        assert row["images_2mm_inside"] > 0
        assert {"tip_known_rate", "tip_far_rate", "tip_bias_px", "missed_contact_images"} <= row.keys()
        assert set(row["tip_z"]) == {"p68", "p95", "p997"}
    full, half = written["rows"][:2]
    assert full["tip_known_rate"] == half["tip_known_rate"] == 1.0
    assert half["tip_error_px"]["median"] < 2


def test_a_folder_may_contain_clips(tmp_path):
    shutil.copytree(CLIP, tmp_path / "b")
    shutil.copytree(CLIP, tmp_path / "a")
    (tmp_path / "no_clip").mkdir()
    assert degraded.clips([tmp_path]) == [tmp_path / "a", tmp_path / "b"]
    assert degraded.clips([tmp_path / "b"]) == [tmp_path / "b"]
    with pytest.raises(BadInput, match="contains no labelled clip"):
        degraded.clips([tmp_path / "no_clip"])
    with pytest.raises(BadInput, match="is no folder"):
        degraded.clips([tmp_path / "absent"])
    with pytest.raises(BadInput, match="no labelled clips found"):
        degraded.clips([])


def test_a_registration_that_is_too_small_at_half_the_size_is_refused(tmp_path):
    shutil.copytree(CLIP, tmp_path / "clip")
    file = tmp_path / "clip" / "registration.toml"
    small = degraded.halved_anatomy(
        degraded.halved_anatomy(anatomy_px(load_camera_registration(CLIP / file.name)))
    )
    file.write_text(degraded.registration_text(small, "Small."))
    with pytest.raises(BadInput, match=r"at half the size.*globe radius"):
        degraded.halved_registration(load_camera_registration(file), tmp_path / "clip")


def truncated_truth(folder):
    rows = (CLIP / "truth.csv").read_text().splitlines()
    (folder / "truth.csv").write_text("\n".join(rows[:-1]) + "\n")


def broken_clip(folder):
    (folder / "clip.mp4").write_bytes(b"no film")


@pytest.mark.parametrize(
    ("damage", "arguments", "message"),
    [
        (truncated_truth, ["{clip}"], "truth.csv: has 38 rows, but the clip has 39 images"),
        (broken_clip, ["{clip}"], "clip.mp4"),
        (None, ["{clip}/absent"], "is no folder"),
        (None, ["{clip}", "--json", "{clip}/absent/scores.json"], "cannot be written"),
    ],
)
def test_bad_input_is_one_sentence_and_exit_code_2(tmp_path, damage, arguments, message):
    folder = tmp_path / "clip"
    shutil.copytree(CLIP, folder)
    if damage:
        damage(folder)
    command = [argument.format(clip=folder) for argument in arguments]
    done = subprocess.run(
        [sys.executable, str(ROOT / "benchmarks" / "degraded.py"), *command],
        capture_output=True,
        text=True,
        cwd=ROOT,
        env={"PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 2
    assert message in done.stderr
    assert len(done.stderr.splitlines()) == 1
