"""The registers of a DRV2605L against the equations of its data sheet, solved for the voltages."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from haptigraph.haptics.boards.motor import Motor


def lra_rms_v(rated, resonance_hz):
    """SLOS854D, equation 5, with SAMPLE_TIME = 300 us."""
    return 20.58e-3 * rated / math.sqrt(1 - (4 * 300e-6 + 300e-6) * resonance_hz)


def erm_peak_v(clamp, drive_time):
    """SLOS854D, equation 8, with IDISS_TIME and BLANKING_TIME of 75 us."""
    drive_s = 1e-3 + 0.2e-3 * drive_time
    return 21.64e-3 * clamp * (drive_s - 300e-6) / (drive_s + 75e-6 + 75e-6)


@given(st.floats(0.5, 3), st.floats(140, 300), st.floats(0, 1))
def test_an_lra_gets_its_rated_voltage_and_never_more_than_the_clamp(rated_v, resonance_hz, more_v):
    clamp_v = rated_v * math.sqrt(2) + more_v
    motor = Motor("lra", rated_v, clamp_v, resonance_hz)
    assert motor.fits
    assert lra_rms_v(motor.rated, resonance_hz) == pytest.approx(
        rated_v, abs=0.5 * lra_rms_v(1, resonance_hz) + 1e-9
    )
    assert clamp_v - 21.22e-3 < 21.22e-3 * motor.clamp <= clamp_v
    feedback, control1, *_ = motor.control(2)
    assert feedback >> 7 == 1
    half_period_s = 0.5e-3 + 0.1e-3 * (control1 & 0x1F)
    assert half_period_s == pytest.approx(0.5 / resonance_hz, abs=0.06e-3)


@given(st.floats(0.5, 4), st.floats(0, 1))
def test_an_erm_gets_its_rated_voltage_and_never_more_than_the_clamp(rated_v, more_v):
    motor = Motor("erm", rated_v, rated_v + more_v, 175.0)
    assert motor.fits
    assert 21.18e-3 * motor.rated == pytest.approx(rated_v, abs=21.18e-3)
    feedback, control1, *_ = motor.control(2)
    assert feedback >> 7 == 0
    assert rated_v + more_v - 22e-3 < erm_peak_v(motor.clamp, control1 & 0x1F) <= rated_v + more_v


def test_the_default_voltage_is_that_of_a_chip_after_a_reset():
    assert abs(Motor("erm", 1.3, 1.3, 175.0).rated - 0x3E) <= 1


@pytest.mark.parametrize("kind", ["erm", "lra"])
def test_the_chip_is_never_made_to_program_its_memory_and_runs_in_a_closed_loop(kind):
    _, _, control2, control3, control4 = Motor(kind, 1.3, 2.0, 175.0).control(2)
    assert control4 & 1 == 0  # OTP_PROGRAM
    assert control3 & 0x21 == 0  # ERM_OPEN_LOOP, LRA_OPEN_LOOP
    assert control3 & 0x08  # amplitudes without sign
    assert not control2 & 0x80  # BIDIR_INPUT
