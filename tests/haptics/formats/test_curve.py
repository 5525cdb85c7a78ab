"""Curves: values at steps, parts, and the strongest of several vibrations."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.haptics.formats.curve import (
    Layer,
    constant,
    cut,
    reduced,
    strongest,
    value_after,
    value_before,
)

STEP = ((0.0, 1.0), (80.0, 1.0), (80.0, 0.0), (160.0, 0.0))
LEVELS = st.lists(st.tuples(st.integers(0, 50), st.integers(0, 10)), min_size=2, max_size=8)


def curve_of(points):
    return tuple(
        (float(time_ms), value / 10) for time_ms, value in sorted(points, key=lambda point: point[0])
    )


def test_a_step_has_two_values():
    assert (value_before(STEP, 80), value_after(STEP, 80)) == (1.0, 0.0)
    assert value_before(((10.0, 0.0), (20.0, 1.0)), 15) == value_after(((10.0, 0.0), (20.0, 1.0)), 15) == 0.5


def test_a_curve_keeps_its_value_beyond_its_ends_and_an_empty_one_has_the_default():
    assert value_after(((10.0, 0.3), (20.0, 1.0)), 5) == 0.3
    assert value_before(((10.0, 0.3), (20.0, 1.0)), 25) == 1.0
    assert value_after((), 5, 7.0) == value_before((), 5, 7.0) == 7.0


def test_a_part_leaves_out_the_steps_at_its_ends():
    assert cut(STEP, 0, 80) == ((0.0, 1.0), (80.0, 1.0))
    assert cut(STEP, 80, 160) == ((80.0, 0.0), (160.0, 0.0))


@given(LEVELS)
def test_a_reduced_curve_has_the_same_values(points):
    curve = curve_of(points)
    for time_ms, _ in curve:
        assert value_before(reduced(curve), time_ms) == pytest.approx(value_before(curve, time_ms))
        assert value_after(reduced(curve), time_ms) == pytest.approx(value_after(curve, time_ms))


def test_the_strongest_is_followed_with_its_frequency():
    rising = Layer(((0.0, 0.0), (100.0, 1.0)), constant(60, 0, 100))
    level = Layer(constant(0.5, 0, 100), constant(200, 0, 100))
    found = strongest([rising, level], 120)
    assert value_after(found.amplitude, 25) == 0.5
    assert value_before(found.amplitude, 75) == pytest.approx(0.75)
    assert value_after(found.frequency_hz, 25) == 200
    assert value_after(found.frequency_hz, 75) == 60
    assert found.amplitude[-2:] == ((100.0, 0.0), (120.0, 0.0))


@given(st.lists(LEVELS.map(curve_of), min_size=1, max_size=9), st.floats(0.1, 49.9))
def test_nothing_is_stronger_than_the_strongest(curves, time_ms):
    found = strongest([Layer(curve) for curve in curves], 50.0)
    inside = [curve for curve in curves if curve[0][0] <= time_ms < curve[-1][0]]
    expected = max((value_after(curve, time_ms) for curve in inside), default=0.0)
    assert value_after(found.amplitude, time_ms) == pytest.approx(expected, abs=1e-6)
