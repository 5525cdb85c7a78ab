"""The registers of a DRV2605L that follow from a motor's data.

Equations and fields: Texas Instruments, SLOS854D, section 8.5 and 8.6.
"""

import math
from typing import Literal

from msgspec import Struct

__all__ = ["FIRST", "Motor"]

FIRST = {"voltages": 0x16, "control": 0x1A}
"""The first register of each group that `Motor` gives."""

ERM_STEP_V, ERM_CLAMP_STEP_V = 21.18e-3, 21.64e-3
LRA_STEP_V, LRA_CLAMP_STEP_V = 20.58e-3, 21.22e-3
SAMPLE_S, OVERHEAD_S = 300e-6, 300e-6  # the reset value of SAMPLE_TIME, and what the equations add
DISSIPATION_S = BLANKING_S = 75e-6  # those of IDISS_TIME and BLANKING_TIME for an ERM
ERM_DRIVE_S = 4.8e-3  # that of DRIVE_TIME, 19 steps of 0.2 ms from 1 ms
BYTE = 255

IS_LRA, BRAKE_4X, LOOP_GAIN_MEDIUM = 0x80, 0x30, 0x04
STARTUP_BOOST = 0x80
UNIDIRECTIONAL = 0x75  # BIDIR_INPUT 0: all 256 values drive forwards; the other fields as after a reset
NOISE_GATE_4_PERCENT, UNSIGNED = 0x80, 0x08  # closed loop: neither ERM_OPEN_LOOP nor LRA_OPEN_LOOP
CALIBRATE_1_S = 0x30


class Motor(Struct, frozen=True):
    """What a motor's data sheet says of it."""

    kind: Literal["erm", "lra"]
    """Eccentric rotating mass, or linear resonant actuator."""
    rated_v: float
    """Rated voltage: RMS for an LRA."""
    clamp_v: float
    """Peak voltage that is never exceeded, also while the motor starts and brakes."""
    resonance_hz: float
    """Of an LRA; the chip follows it from there."""

    @property
    def rated(self) -> int:
        """RATED_VOLTAGE, which full amplitude drives."""
        if self.kind == "erm":
            return round(self.rated_v / ERM_STEP_V)
        share = math.sqrt(1 - (4 * SAMPLE_S + OVERHEAD_S) * self.resonance_hz)
        return round(self.rated_v * share / LRA_STEP_V)

    @property
    def clamp(self) -> int:
        """OD_CLAMP."""
        if self.kind == "lra":
            return int(self.clamp_v / LRA_CLAMP_STEP_V)
        share = (ERM_DRIVE_S - OVERHEAD_S) / (ERM_DRIVE_S + DISSIPATION_S + BLANKING_S)
        return int(self.clamp_v / (ERM_CLAMP_STEP_V * share))

    @property
    def fits(self) -> bool:
        """Whether the registers can hold these voltages, and the motor is driven at all."""
        return 1 <= self.rated <= BYTE and 1 <= self.clamp <= BYTE

    @property
    def peak_v(self) -> float:
        """Peak of the rated voltage: a lower clamp would weaken full amplitude."""
        return self.rated_v * (math.sqrt(2) if self.kind == "lra" else 1)

    def control(self, gain: int) -> tuple[int, ...]:
        """Return FEEDBACK_CONTROL and CONTROL1 to CONTROL4: closed loop, real-time playback without sign.

        Args:
            gain: BEMF_GAIN, 0 to 3.
        """
        half_period_s = 0.5 / self.resonance_hz
        steps = round((half_period_s - 0.5e-3) / 0.1e-3) if self.kind == "lra" else 19
        feedback = BRAKE_4X | LOOP_GAIN_MEDIUM | gain | (IS_LRA if self.kind == "lra" else 0)
        return (
            feedback,
            STARTUP_BOOST | steps,
            UNIDIRECTIONAL,
            NOISE_GATE_4_PERCENT | UNSIGNED,
            CALIBRATE_1_S,
        )
