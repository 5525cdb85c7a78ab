"""The robust line: outliers, systematic errors, and what is no line."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.perception.depth.line_fit import MIN_SAMPLES, robust_line

SD = 0.1


def none(count):
    return np.zeros((1, count))


@given(
    st.floats(-3, 3),
    st.floats(-2, 2),
    st.integers(8, 30),
    st.floats(0, 0.45),
    st.integers(0, 2**16),
)
def test_most_samples_decide_whatever_the_others_are(offset, slope, count, outlier_share, seed):
    rng, at = np.random.default_rng(seed), np.arange(count) * 1.0
    values = offset + slope * at + rng.uniform(-SD, SD, count)
    wrong = rng.choice(count, int(outlier_share * count), replace=False)
    values[wrong] += rng.uniform(20, 60, len(wrong)) * rng.choice((-1, 1), len(wrong))
    fit = robust_line(at, values, SD, none(count))
    assert fit is not None
    for end in (0.0, count - 1.0):
        sd = np.sqrt(np.array([1, end]) @ fit.covariance @ np.array([1, end]))
        assert abs(fit(end) - offset - slope * end) < 4 * sd


def test_the_standard_deviation_is_that_of_the_errors():
    rng, at = np.random.default_rng(3), np.arange(20.0)
    errors = []
    for _ in range(400):
        fit = robust_line(at, 2 + 0.1 * at + rng.normal(0, SD, 20), SD, none(20))
        errors.append((fit(19.0) - 3.9) / np.sqrt(np.array([1, 19]) @ fit.covariance @ np.array([1, 19])))
    assert 0.5 < np.std(errors) < 1.0  # neighbours might err alike, here they do not


def test_an_error_that_all_share_is_in_the_standard_deviation():
    at = np.arange(10.0)
    alone, shared = (robust_line(at, 0.5 * at, SD, error * np.ones((1, 10))) for error in (0.0, 3.0))
    assert shared.covariance[0, 0] - alone.covariance[0, 0] == pytest.approx(9.0)
    assert shared.covariance[1, 1] == pytest.approx(alone.covariance[1, 1])


def test_too_few_samples_and_what_is_on_no_line_are_refused():
    at = np.arange(30.0)
    assert robust_line(at[: MIN_SAMPLES - 1], at[: MIN_SAMPLES - 1], SD, none(MIN_SAMPLES - 1)) is None
    assert robust_line(at, 5 * np.sin(at), SD, none(30)) is None


def test_one_sample_that_the_others_cannot_check_decides_nothing():
    at = np.array([0.0, 1.0, 2.0, 20.0])
    assert robust_line(at, 0.1 * at, SD, none(4)) is None
    assert robust_line(np.append(at, 19.0), 0.1 * np.append(at, 19.0), SD, none(5)) is not None


def test_what_one_part_errs_by_hardly_turns_a_line_that_the_other_part_shows():
    at = np.arange(20.0)
    is_far = at >= 14
    off = np.where(is_far, 5 * SD, 0.0)
    fit = robust_line(at, 0.1 * at + 0.6 * off, SD, off[None, :])
    assert fit is not None
    assert abs(fit.answer[1] - 0.1) < 2 * np.sqrt(fit.covariance[1, 1])
    assert abs(fit.answer[1] - 0.1) < 0.6 * abs(np.polyfit(at, 0.6 * off, 1)[0])
