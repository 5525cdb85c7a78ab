import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.teleop.band_stop import BandStop

rates_hz = st.sampled_from([25.0, 30.0, 60.0, 120.0])


def answer(rate_hz: float, frequency_hz: float) -> complex:
    """What a filter makes of a long sine, as gain times exp(i phase): measured, not computed."""
    stop = BandStop(rate_hz)
    times_s = np.arange(round(16 * rate_hz)) / rate_hz
    turns = 2 * math.pi * frequency_hz * times_s
    out = np.array([stop(np.array([math.sin(turn), 0.0]))[0] for turn in turns])
    settled = times_s >= 6  # whole periods of any frequency of a tenth of a hertz
    return complex(2 * np.mean(out[settled] * np.exp(-1j * (turns[settled] - math.pi / 2))))


def delay_ms(response: complex, frequency_hz: float) -> float:
    return -math.degrees(np.angle(response)) / 360 / frequency_hz * 1e3


@settings(max_examples=40)
@given(rates_hz, st.integers(80, 120))
def test_of_tremor_a_tenth_is_left(rate_hz, tenths_of_hz):
    assert abs(answer(rate_hz, tenths_of_hz / 10)) <= 0.1005


@pytest.mark.parametrize("frequency_hz", [8.0, 12.0])
def test_the_edges_of_the_band_are_where_they_are_said_to_be(frequency_hz):
    assert abs(answer(30.0, frequency_hz)) == pytest.approx(0.1, abs=1e-3)


def test_at_30_samples_a_second_it_is_as_the_docs_say():
    assert abs(answer(30.0, 10.0)) == pytest.approx(0.097, abs=5e-4)
    assert delay_ms(answer(30.0, 1.0), 1.0) == pytest.approx(29, abs=0.5)
    assert delay_ms(answer(60.0, 1.0), 1.0) == pytest.approx(22, abs=0.5)


@settings(max_examples=40)
@given(rates_hz, st.integers(1, 20))
def test_voluntary_motion_keeps_its_size_and_comes_soon(rate_hz, tenths_of_hz):
    response = answer(rate_hz, tenths_of_hz / 10)
    assert abs(response) == pytest.approx(1, abs=0.01)
    assert 0 < delay_ms(response, tenths_of_hz / 10) < 37


@settings(max_examples=25)
@given(rates_hz, st.lists(st.tuples(st.floats(-10, 10), st.floats(-10, 10)), min_size=1, max_size=20))
def test_what_goes_in_comes_out_in_the_end(rate_hz, displacements):
    stop = BandStop(rate_hz)
    out = sum(stop(np.array(pair)) for pair in displacements)
    out += sum(stop(np.zeros(2)) for _ in range(round(8 * rate_hz)))
    assert out == pytest.approx(np.sum(displacements, axis=0), abs=1e-3)


def test_after_a_reset_nothing_is_left():
    stop = BandStop(30.0)
    stop(np.array([1.0, -1.0]))
    stop.reset()
    assert stop(np.zeros(2)).tolist() == [0, 0]


def test_a_rate_that_cannot_show_tremor_is_refused():
    with pytest.raises(ValueError, match="needs 25 samples/s, found 15"):
        BandStop(15.0)
