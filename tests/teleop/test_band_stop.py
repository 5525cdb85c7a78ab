import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.teleop.band_stop import BandStop

rates_hz = st.sampled_from([25.0, 30.0, 60.0, 120.0])


def measured_response(rate_hz: float, frequency_hz: float) -> complex:
    """Return gain times exp(i phase), measured with a long sine."""
    band_stop = BandStop(rate_hz)
    times_s = np.arange(round(16 * rate_hz)) / rate_hz
    phases = 2 * math.pi * frequency_hz * times_s
    out = np.array([band_stop(np.array([math.sin(phase), 0.0]))[0] for phase in phases])
    is_settled = times_s >= 6  # whole periods of any multiple of 0.1 Hz
    return complex(2 * np.mean(out[is_settled] * np.exp(-1j * (phases[is_settled] - math.pi / 2))))


def delay_ms(response: complex, frequency_hz: float) -> float:
    return -math.degrees(np.angle(response)) / 360 / frequency_hz * 1e3


@settings(max_examples=40)
@given(rates_hz, st.integers(80, 120))
def test_the_gain_in_the_tremor_band_is_at_most_a_tenth(rate_hz, tenths_of_hz):
    assert abs(measured_response(rate_hz, tenths_of_hz / 10)) <= 0.1005


@pytest.mark.parametrize("frequency_hz", [8.0, 12.0])
def test_the_gain_at_the_edges_of_the_band_is_a_tenth(frequency_hz):
    assert abs(measured_response(30.0, frequency_hz)) == pytest.approx(0.1, abs=1e-3)


def test_gain_and_delay_are_as_documented():
    assert abs(measured_response(30.0, 10.0)) == pytest.approx(0.097, abs=5e-4)
    assert delay_ms(measured_response(30.0, 1.0), 1.0) == pytest.approx(29, abs=0.5)
    assert delay_ms(measured_response(60.0, 1.0), 1.0) == pytest.approx(22, abs=0.5)


@settings(max_examples=40)
@given(rates_hz, st.integers(1, 20))
def test_voluntary_motion_keeps_its_amplitude_and_is_hardly_delayed(rate_hz, tenths_of_hz):
    response = measured_response(rate_hz, tenths_of_hz / 10)
    assert abs(response) == pytest.approx(1, abs=0.01)
    assert 0 < delay_ms(response, tenths_of_hz / 10) < 37


@settings(max_examples=25)
@given(rates_hz, st.lists(st.tuples(st.floats(-10, 10), st.floats(-10, 10)), min_size=1, max_size=20))
def test_the_sum_of_displacements_is_preserved(rate_hz, displacements):
    band_stop = BandStop(rate_hz)
    out = sum(band_stop(np.array(pair)) for pair in displacements)
    out += sum(band_stop(np.zeros(2)) for _ in range(round(8 * rate_hz)))
    assert out == pytest.approx(np.sum(displacements, axis=0), abs=1e-3)


def test_reset_clears_the_state():
    band_stop = BandStop(30.0)
    band_stop(np.array([1.0, -1.0]))
    band_stop.reset()
    assert band_stop(np.zeros(2)).tolist() == [0, 0]


def test_a_rate_too_low_for_tremor_is_refused():
    with pytest.raises(ValueError, match="needs at least 25 samples/s, found 15"):
        BandStop(15.0)
