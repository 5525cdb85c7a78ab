import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from robot_runs import random_transform

from haptigraph.errors import BadInput
from haptigraph.robot.place.rigid_fit import fit_points, procrustes

EYE_MM = np.array(
    [[-8.0, 6, 0], [7, 5, 1], [0, -11, -2], [4, -2, 6], [-5, 1, -6], [2, 9, 3], [-9, -3, 4], [6, -8, -5]]
)


def fit(base_mm, eye_mm=EYE_MM, sd_mm=0.05):
    return fit_points(base_mm, eye_mm, np.full(len(eye_mm), sd_mm), max_rms_mm=0.5, what="touched.csv")


@given(st.integers(0, 10_000))
def test_exact_points_give_the_transform(seed):
    true = random_transform(np.random.default_rng(seed))
    found = fit(true.inverse().point_mm(EYE_MM))
    np.testing.assert_allclose(found.eye_from_base.rotation, true.rotation, atol=1e-9)
    np.testing.assert_allclose(found.eye_from_base.translation_mm, true.translation_mm, atol=1e-6)
    assert not found.is_planar and found.rms_mm < 1e-6


@given(st.integers(0, 10_000))
def test_an_outlier_is_left_out(seed):
    rng = np.random.default_rng(seed)
    true = random_transform(rng)
    base_mm = true.inverse().point_mm(EYE_MM) + rng.normal(0, 0.02, EYE_MM.shape)
    wrong = int(rng.integers(len(EYE_MM)))
    base_mm[wrong] += 4.0
    found = fit(base_mm)
    assert found.used.tolist() == [float(number != wrong) for number in range(len(EYE_MM))]
    np.testing.assert_allclose(
        found.eye_from_base.point_mm(true.inverse().point_mm(EYE_MM)), EYE_MM, atol=0.2
    )


def test_points_in_a_plane_are_said_to_be():
    flat = EYE_MM * (1, 1, 0)
    assert fit(random_transform(np.random.default_rng(1)).inverse().point_mm(flat), flat).is_planar


@pytest.mark.parametrize(
    "spoil, problem",
    [
        (lambda base: base[:3], "3 points are too few"),
        (lambda base: base / 1000, "m instead of mm"),
        (lambda base: base * 1000, "µm instead of mm"),
        (lambda base: base * 1.1, "0.909 times"),
        (lambda base: base * (1, 1, -1), "mirrored"),
        (lambda base: base + np.random.default_rng(0).normal(0, 2, base.shape), "too few|agree|fit|times"),
    ],
)
def test_what_cannot_be_a_right_handed_robot_in_mm_is_refused(spoil, problem):
    base_mm = spoil(random_transform(np.random.default_rng(2)).inverse().point_mm(EYE_MM))
    with pytest.raises(BadInput, match=problem) as refusal:
        fit(base_mm, EYE_MM[: len(base_mm)])
    assert refusal.value.file == "touched.csv"


def test_points_on_a_line_are_refused():
    line = np.outer(np.linspace(-8, 8, 6), (0.6, -0.8, 0.0))
    with pytest.raises(BadInput, match="of one line"):
        fit(random_transform(np.random.default_rng(3)).inverse().point_mm(line), line)


def test_the_fit_is_never_a_reflection():
    mirrored = procrustes(EYE_MM * (1, 1, -1), EYE_MM, np.ones(len(EYE_MM)))
    assert mirrored.is_mirrored and np.linalg.det(mirrored.rotation) > 0
