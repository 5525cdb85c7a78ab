import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from haptigraph.analysis.metrics.motion import (
    band_power,
    log_dimensionless_jerk,
    low_passed,
    path_length,
    sparc,
    speed,
)

RATE_HZ = 30.0
TIME_S = np.arange(0, 20, 1 / RATE_HZ)


def test_smoothness_equals_the_authors_worked_example():
    """S. Balasubramanian's smoothness.py (github.com/siva82kb/smoothness): sparc and log_dimensionless_jerk."""
    movement = np.exp(-5 * np.arange(-1, 1, 0.01) ** 2)
    assert sparc(movement, 100.0) == pytest.approx(-1.41403, abs=5e-6)
    assert log_dimensionless_jerk(movement, 100.0) == pytest.approx(-5.81636, abs=5e-6)


def test_an_intermittent_movement_is_less_smooth():
    single = np.exp(-5 * np.arange(-1, 1, 0.01) ** 2)
    intermittent = np.concatenate([single, np.zeros(50), single])
    assert sparc(intermittent, 100.0) < sparc(single, 100.0) - 0.3
    assert log_dimensionless_jerk(intermittent, 100.0) < log_dimensionless_jerk(single, 100.0) - 1


@settings(max_examples=20)
@given(st.floats(0.01, 100), st.floats(30, 200))
def test_smoothness_is_dimensionless(size, rate_hz):
    movement = np.exp(-5 * np.linspace(-1, 1, 200) ** 2)
    assert log_dimensionless_jerk(size * movement, rate_hz) == pytest.approx(
        log_dimensionless_jerk(movement, 100.0), rel=1e-6
    )
    assert sparc(size * movement, 100.0) == pytest.approx(sparc(movement, 100.0), rel=1e-6)


def test_without_motion_there_is_no_smoothness():
    assert sparc(np.zeros(100), RATE_HZ) is None
    assert log_dimensionless_jerk(np.zeros(100), RATE_HZ) is None


@settings(max_examples=60)
@given(
    st.floats(24.5, 120) | st.sampled_from([30.0000003, 29.9999997, 25.0]),
    st.floats(8, 12) | st.sampled_from([8.0, 12.0]),
    st.floats(0.01, 2),
    st.floats(0, 7),
)
def test_the_power_of_a_tremor_is_half_its_squared_amplitude(rate_hz, frequency_hz, amplitude_mm, phase):
    time_s = np.arange(0, 6, 1 / rate_hz)
    position_mm = amplitude_mm * np.sin(2 * np.pi * frequency_hz * time_s + phase)
    drifting = np.column_stack([position_mm + 0.5 * time_s, 2 * time_s])
    tolerance = 0.01 if rate_hz >= 26 else 0.1
    assert band_power(drifting, rate_hz) == pytest.approx(amplitude_mm**2 / 2, rel=tolerance)


def test_only_the_band_counts_and_low_rates_have_no_band_power():
    slow = np.column_stack([np.sin(2 * np.pi * 1.0 * TIME_S), TIME_S])
    assert band_power(slow, RATE_HZ) < 1e-6
    for outside_hz in (6.5, 13.5):
        assert band_power(np.sin(2 * np.pi * outside_hz * TIME_S)[:, None], RATE_HZ) < 1e-6
    assert band_power(np.sin(2 * np.pi * 12.75 * TIME_S)[:, None], RATE_HZ) == pytest.approx(0.25, rel=0.01)
    assert band_power(slow, 24.0) is None and band_power(slow, 9.0) is None
    assert band_power(slow[:59], RATE_HZ) is None is not band_power(slow[:60], RATE_HZ)


def test_the_low_pass_has_the_specified_gain():
    middle = slice(150, -150)
    for frequency_hz, gain in ((0.5, 1.0), (5.0, 0.5), (12.0, 0.03)):
        wave = np.sin(2 * np.pi * frequency_hz * TIME_S)
        amplitude = low_passed(wave, RATE_HZ)[middle].std() * np.sqrt(2)
        assert amplitude == pytest.approx(gain, abs=0.02)
    line = np.column_stack([TIME_S, 3 - 2 * TIME_S])
    assert low_passed(line, RATE_HZ) == pytest.approx(line, abs=0.01)


def test_length_and_speed_of_a_circle():
    circle = 2.0 * np.column_stack([np.cos(TIME_S), np.sin(TIME_S)])
    assert path_length(circle) == pytest.approx(2.0 * TIME_S[-1], rel=1e-3)
    assert speed(circle, RATE_HZ)[1:-1] == pytest.approx(2.0, rel=1e-3)
