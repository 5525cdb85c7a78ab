"""Evidence for needles, against the same sum in NumPy."""

import numpy as np
import pytest

from haptigraph.perception.native.needle_scores import needle_scores
from haptigraph.perception.volume.bevelled import COUNT, RADIUS, Frame, pose_of, rows_of
from haptigraph.sim.oct.volumes.needle import VolumeNeedle, upper_mm
from haptigraph.sim.oct.volumes.needle import pose as true_pose

AXIAL_MM, ROWS = 0.01, 120
BEAM = np.array([[0.0, 0.0], [0.004, -0.006]])


def scans(rng, count):
    return np.column_stack([rng.uniform(-0.5, 0.3, count), rng.uniform(-0.2, 0.2, count), np.ones(count)])


@pytest.mark.parametrize("roll_deg", [0.0, 60.0, 120.0, 180.0, -100.0])
def test_scores_are_the_evidence_at_the_upper_side_of_the_simulated_needle(roll_deg):
    rng = np.random.default_rng(3)
    at, stops = scans(rng, 200), rng.normal(0, 3, (200, ROWS)).astype(np.float32)
    shape, needle = (
        VolumeNeedle(bevel_deg=30.0),
        true_pose(np.array([0.02, -0.05, 0.01]), 35.0, 10.0, roll_deg),
    )
    parameters = np.zeros((1, COUNT))
    parameters[0, 5:] = np.radians(roll_deg), shape.diameter_mm / 2, np.radians(30.0)
    frame = Frame(needle.axis_mm(shape.diameter_mm), np.radians(35.0), np.radians(10.0))
    poses = rows_of(pose_of(frame, parameters), parameters)
    expected = 0.0
    for shift_x, shift_z in BEAM:
        tops, _ = upper_mm(needle, shape, at[:, 0] + shift_x, at[:, 1] + shift_z)
        for top, evidence in zip(tops, stops, strict=True):
            if np.isfinite(top):
                expected += np.interp((ROWS - 1) / 2 - top / AXIAL_MM, np.arange(ROWS), evidence) / len(BEAM)
    assert expected != 0
    assert needle_scores(at, stops, AXIAL_MM, poses, BEAM) == pytest.approx([expected], rel=1e-5, abs=1e-4)


def test_a_weight_counts_an_a_scan_as_often():
    rng = np.random.default_rng(5)
    at, stops = scans(rng, 50), rng.normal(0, 3, (50, ROWS)).astype(np.float32)
    parameters = np.zeros((2, COUNT))
    parameters[:, RADIUS], parameters[:, 7] = 0.05, 0.5
    poses = rows_of(pose_of(Frame(np.zeros(3), 0.6, 0.1), parameters), parameters)
    once = needle_scores(at, stops, AXIAL_MM, poses, BEAM)
    twice = needle_scores(at * [1, 1, 2], stops, AXIAL_MM, poses, BEAM)
    assert once[0] == once[1]
    assert twice == pytest.approx(2 * once)


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"at": np.zeros((3, 2))}, "at: expected"),
        ({"stops": np.zeros((4, ROWS))}, "stops: expected"),
        ({"stops": np.zeros((3, 1), np.float32)}, "2 rows"),
        ({"poses": np.zeros((2, 12))}, "poses: expected"),
        ({"beam_mm": np.zeros((0, 2))}, "expected"),
        ({"axial_mm": 0.0}, "positive scale"),
        ({"axial_mm": float("nan")}, "positive scale"),
    ],
)
def test_wrong_arrays_never_reach_c(change, error):
    right = {
        "at": np.zeros((3, 3)),
        "stops": np.zeros((3, ROWS), np.float32),
        "axial_mm": AXIAL_MM,
        "poses": np.zeros((2, 13)),
        "beam_mm": BEAM,
    }
    needle_scores(**right)
    with pytest.raises(ValueError, match=error):
        needle_scores(**(right | change))


def test_not_a_number_is_a_score_not_a_crash():
    at = np.full((3, 3), np.nan)
    poses = np.full((1, 13), np.nan)
    assert needle_scores(at, np.zeros((3, ROWS), np.float32), AXIAL_MM, poses, BEAM).shape == (1,)
