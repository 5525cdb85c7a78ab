import json

import numpy as np
import pytest
from helpers import call, refuse
from paths import SHARED

from haptigraph.analysis.evaluation import volumes
from haptigraph.analysis.evaluation.volumes import evaluate_volumes
from haptigraph.analysis.evaluation.volumes_report import volume_scores
from haptigraph.errors import BadInput
from haptigraph.perception.instrument.model import VOXEL_MM, InstrumentPose
from haptigraph.perception.instrument.rotations import euler_xyz_matrix

COUNT = 120
OFFSET_MM = np.array([0.3, -2.0, 1.0])
FRAME = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])  # from the labelled frame to the eye frame
AXIS = np.array([0.6, 0.0, 0.8])
NOISE_MM = 0.003
REAL = SHARED / "oct_volumes"


def pose(label, tip_mm):
    rotation = FRAME @ euler_xyz_matrix(label[3:]) @ FRAME.T
    return InstrumentPose(tip_mm, rotation @ AXIS, AXIS, rotation, 0.0, np.full(3, 0.003), 0.1, 0.3, 100.0)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Write volumes that contain their number, whose poses are found as they are labelled, with noise."""
    rng = np.random.default_rng(7)
    labels = rng.uniform(0, 1, (COUNT, 6)) * [1, 1, 0.6, 6, 6, 8]
    poses = {}
    for number, label in enumerate(labels):
        volume = np.full((16, 3, 4), number, np.uint8)
        np.savez(tmp_path / f"{1000 + 60 * number}.5.npz", data=volume, pos=label)
        tip = FRAME @ (label[:3] + euler_xyz_matrix(label[3:]) @ OFFSET_MM)
        drift = np.array([0, 0.08 * (number > 70), 0])
        poses[number] = pose(label, tip + drift + rng.normal(0, NOISE_MM, 3))
    learned = []
    monkeypatch.setattr(
        volumes, "learn_instrument", lambda taken, *_: learned.extend(int(each[0, 0, 0]) for each in taken)
    )
    monkeypatch.setattr(volumes, "find_instrument", lambda volume, model: poses[int(volume[0, 0, 0])])
    return tmp_path, poses, learned


def test_scores_have_the_noise_and_drift_of_the_volumes(folder):
    path, _, learned = folder
    evaluation = evaluate_volumes(path, VOXEL_MM)
    assert learned == list(range(0, COUNT, 2))  # never one that is reported on
    assert evaluation.offset_mm == pytest.approx(OFFSET_MM, abs=0.1)
    scores = volume_scores(evaluation)
    assert (scores["volumes"], scores["known_rate"], scores["gross_errors"]) == (COUNT // 2, 1.0, 0)
    drifting, corrected = scores["without_drift"], scores["with_drift"]
    assert corrected["tip_residual_um"]["median"] < 8 < 20 < drifting["tip_residual_um"]["median"]
    assert max(corrected["tip_sd_axis_um"]) < 8
    assert corrected["axis_residual_deg"]["p95"] < 0.05
    assert 0.75 < corrected["tip_z"]["p68"] < 1.25
    swapped = evaluate_volumes(path, VOXEL_MM, swapped=True)
    assert learned[COUNT // 2 :] == list(range(1, COUNT, 2))
    assert swapped.known == COUNT // 2


def test_unknown_poses_and_gross_errors_are_counted(folder):
    path, poses, _ = folder
    poses[11] = poses[21] = poses[20] = None
    poses[31] = pose(np.array([0.5, 0.5, 0.3, 3, 3, 4]), poses[31].tip_mm + 1.5)
    scores = volume_scores(evaluate_volumes(path, VOXEL_MM))
    assert scores["volumes"] == COUNT // 2
    assert scores["known_rate"] == pytest.approx(1 - 2 / (COUNT // 2))
    assert scores["gross_errors"] == 1


@pytest.mark.slow
def test_a_calibration_far_off_does_not_move_the_map(folder):
    path, poses, _ = folder
    poses[30] = pose(np.array([0.5, 0.5, 0.3, 3, 3, 4]), poses[30].tip_mm + 1.5)
    scores = volume_scores(evaluate_volumes(path, VOXEL_MM))
    assert scores["with_drift"]["tip_residual_um"]["median"] < 10


def test_the_command_prints_scores_and_a_table(folder):
    path, _, _ = folder
    scores = json.loads(call("evaluate", "--volumes", path, "--json").output)
    assert list(scores) == [
        *("volumes", "known_rate", "gross_errors", "without_drift", "with_drift", "origin")
    ]
    assert {"tip_residual_um", "tip_sd_axis_um", "axis_residual_deg", "tip_z"} <= set(scores["with_drift"])
    assert set(scores["with_drift"]["tip_z"]) == {"p68", "p95", "p997"}
    text = call("evaluate", "--volumes", path).output
    assert "60 volumes calibrated, 60 others reported on" in text
    assert "tip z: p68 / p95 / p997" in text
    assert "goes with --voxel-mm and --json only" in refuse("evaluate", "--volumes", path, "--seed", 1)
    assert "--voxel-mm goes with --volumes" in refuse("evaluate", "--simulated", 1, "--voxel-mm", "1,1,1")


def test_too_few_volumes_are_refused_in_a_sentence(folder):
    path, poses, _ = folder
    for number in range(0, COUNT - 40, 2):
        poses[number] = None
    with pytest.raises(BadInput, match="found in 20 of 60 volumes to calibrate; a quadratic map needs 30"):
        evaluate_volumes(path, VOXEL_MM)
    for file in sorted(path.iterdir(), key=lambda file: float(file.stem))[58:]:
        file.unlink()
    with pytest.raises(BadInput, match="found 58 volumes, 29 of them to calibrate"):
        evaluate_volumes(path, VOXEL_MM)


@pytest.mark.slow
@pytest.mark.skipif(not REAL.is_dir(), reason="needs the real volumes beside the checkout")
def test_real_volumes():
    scores = volume_scores(evaluate_volumes(REAL, VOXEL_MM))
    assert (scores["known_rate"], scores["gross_errors"]) == (1.0, 0)
    assert scores["with_drift"]["tip_residual_um"]["median"] <= 8
    assert scores["with_drift"]["tip_residual_um"]["p95"] <= 20
    assert scores["with_drift"]["axis_residual_deg"]["median"] <= 0.12
    assert scores["without_drift"]["tip_residual_um"]["median"] <= 31
