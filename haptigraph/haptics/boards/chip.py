"""One DRV2605L at the level of its registers (Texas Instruments, SLOS854D, section 8.6)."""

import time

from msgspec import Struct

from haptigraph.errors import DeviceError
from haptigraph.haptics.boards.board import SETUP_S
from haptigraph.haptics.boards.i2c import I2cBus
from haptigraph.haptics.boards.motor import FIRST, Motor

__all__ = ["ADDRESS", "AutoCalibration", "Chip", "amplitude_command", "standby_commands"]

ADDRESS = 0x5A
STATUS, MODE, AMPLITUDE, GO, CALIBRATION, PERIOD = 0x00, 0x01, 0x02, 0x0C, 0x18, 0x22
DEVICE_ID, DIAGNOSTIC, OVER_TEMPERATURE, OVER_CURRENT = 7, 0x08, 0x02, 0x01
INTERNAL, REAL_TIME, CALIBRATE, STANDBY = 0x00, 0x05, 0x07, 0x40
PERIOD_S = 98.46e-6  # of a step of LRA_PERIOD
MAX_GAIN = 3
CALIBRATED_WITHIN_S, POLL_S = 3.0, 0.05  # AUTO_CAL_TIME is 1.0 to 1.2 s


class AutoCalibration(Struct, frozen=True):
    """What a chip has measured of its motor. It forgets this without power."""

    compensation: int = 0x0C
    """A_CAL_COMP: of resistive losses. The defaults are those of the chip."""
    back_emf: int = 0x6C
    """A_CAL_BEMF: the motor's back EMF."""
    gain: int = 2
    """BEMF_GAIN."""
    resonance_hz: float | None = None
    """Measured resonance of an LRA."""

    @property
    def text(self) -> str:
        """The value of the option `calibration` that restores it."""
        return f"{self.compensation}-{self.back_emf}-{self.gain}"


class Chip:
    """A DRV2605L on a bus, or on the connected channel of its multiplexer.

    Args:
        bus: The bus.
        motor: The motor at its output.
        name: How errors call the chip.
    """

    def __init__(self, bus: I2cBus, motor: Motor, name: str) -> None:
        self._bus, self._motor, self._name = bus, motor, name

    def set_up(self, calibration: AutoCalibration) -> None:
        """Verify that it is a DRV2605L, configure it silently, and verify what was written.

        Raises:
            DeviceError: If it is another chip, or does not hold what was written.
        """
        self._write(MODE, INTERNAL)  # out of standby, in which it ignores most registers
        self._write(AMPLITUDE, 0)
        self._write(GO, 0)
        status = self._read(STATUS, 1)[0]
        if status >> 5 != DEVICE_ID:
            raise DeviceError(
                f"{self._name} is not a DRV2605L, whose device id is {DEVICE_ID}: found {status >> 5}"
            )
        self._configure(calibration)
        self._write(MODE, REAL_TIME)

    def request(self) -> None:
        """Ask what the chip plays, for `verify`."""
        self._bus.request(ADDRESS, STATUS, 3)

    def verify(self, value: int, within_s: float) -> None:
        """Check that the chip played a value at the request, and nothing else.

        Raises:
            DeviceError: If it was reset, has shut its output down, or does not answer.
        """
        status, mode, played = self._bus.answer(ADDRESS, STATUS, 3, within_s)
        if status >> 5 != DEVICE_ID or (mode, played) != (REAL_TIME, value):
            raise DeviceError(f"{self._name} was reset: it does not play what was set")
        if status & OVER_CURRENT:
            raise DeviceError(f"{self._name} reports too much current; check the motor and its wires")
        if status & OVER_TEMPERATURE:
            raise DeviceError(f"{self._name} is too hot; let it cool down")

    def calibrate(self) -> AutoCalibration:
        """Let the chip measure its motor, which vibrates for about a second; the chip ends that by itself.

        Raises:
            DeviceError: If the measurement fails.
        """
        self.set_up(AutoCalibration())
        self._write(MODE, CALIBRATE)
        self._write(GO, 1)
        give_up_s = time.monotonic() + CALIBRATED_WITHIN_S
        while self._read(GO, 1)[0] & 1:
            if time.monotonic() > give_up_s:
                raise DeviceError(f"{self._name} does not finish its calibration")
            time.sleep(POLL_S)
        if self._read(STATUS, 1)[0] & (DIAGNOSTIC | OVER_CURRENT | OVER_TEMPERATURE):
            raise DeviceError(
                f"{self._name} could not calibrate its motor; check its wires, its kind ({self._motor.kind}) "
                "and voltage, and hold what it is fixed to"
            )
        compensation, back_emf, feedback = self._read(CALIBRATION, 3)
        resonance_hz = None
        if self._motor.kind == "lra" and (period := self._read(PERIOD, 1)[0]):
            resonance_hz = 1 / (period * PERIOD_S)
        return AutoCalibration(compensation, back_emf, feedback & MAX_GAIN, resonance_hz)

    def _configure(self, calibration: AutoCalibration) -> None:
        """Write the configuration, and verify it."""
        groups = {
            FIRST["voltages"]: (
                self._motor.rated,
                self._motor.clamp,
                calibration.compensation,
                calibration.back_emf,
            ),
            FIRST["control"]: self._motor.control(calibration.gain),
        }
        for first, values in groups.items():
            self._write(first, *values)
            if (held := tuple(self._read(first, len(values)))) != values:
                raise DeviceError(
                    f"{self._name} does not hold its configuration: the registers from {first:#04x} are "
                    f"{bytes(held).hex()}, written was {bytes(values).hex()}"
                )

    def _write(self, register: int, *values: int) -> None:
        self._bus.write(ADDRESS, register, *values)

    def _read(self, register: int, count: int) -> bytes:
        return self._bus.read(ADDRESS, register, count, SETUP_S)


def amplitude_command(value: int) -> tuple[int, ...]:
    """Return what is written to a chip so that it plays a value, 0 to 255."""
    return ADDRESS, AMPLITUDE, value


def standby_commands() -> tuple[tuple[int, ...], ...]:
    """Return what is written to a chip in any state so that it is silent."""
    return amplitude_command(0), (ADDRESS, MODE, STANDBY | REAL_TIME)
