import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.perception.baseline.smoothing import MovingAverage


def test_smoothing_follows_the_papers_formula():
    smooth = MovingAverage(alpha=0.25)
    assert smooth((0.0, 0.0), (1.0, 0.0)) == ((0.0, 0.0), (1.0, 0.0))
    tip, direction = smooth((4.0, 8.0), (0.0, 1.0))
    assert tip == (1.0, 2.0)
    assert direction == pytest.approx((0.75 / 0.625**0.5, 0.25 / 0.625**0.5))


def test_an_alpha_of_one_disables_smoothing():
    smooth = MovingAverage(alpha=1.0)
    smooth((0.0, 0.0), (1.0, 0.0))
    assert smooth((3.0, -2.0), (0.0, 1.0)) == ((3.0, -2.0), (0.0, 1.0))


def test_reset_restarts_smoothing():
    smooth = MovingAverage(alpha=0.1)
    smooth((0.0, 0.0), (1.0, 0.0))
    smooth.reset()
    assert smooth((9.0, 9.0), (0.0, 1.0)) == ((9.0, 9.0), (0.0, 1.0))


@given(st.floats(0.05, 1.0), st.floats(-20, 20), st.floats(-20, 20))
def test_it_converges_to_a_static_needle(alpha, x, y):
    smooth = MovingAverage(alpha)
    smooth((0.0, 0.0), (1.0, 0.0))
    for _ in range(400):
        tip, _ = smooth((x, y), (1.0, 0.0))
    assert tip == pytest.approx((x, y), abs=1e-3)
