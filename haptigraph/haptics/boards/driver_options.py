"""The options of the device `drv2605`."""

from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.haptics.boards.board import whole_number
from haptigraph.haptics.boards.chip import MAX_GAIN, AutoCalibration
from haptigraph.haptics.boards.motor import BYTE, Motor

__all__ = ["OPTIONS", "DriverOptions", "driver_options"]

OPTIONS = (
    "motor=lra|erm&rated_v=V&clamp_v=V&hz=F&mux=0x70&channel=N,N&enable=PIN&calibration=C-B-G,C-B-G&baud=N"
)
RATED_V = 1.3  # of a chip after a reset; motors are rated 1.3 V or more
RESONANCE_HZ = 175.0  # Precision Microdrives C10-100, a usual 10 mm LRA
LOWEST_HZ, HIGHEST_HZ = 140.0, 300.0  # the longest half period that DRIVE_TIME holds; SLOS854D, section 6.5


class DriverOptions(Struct, frozen=True):
    """What the user has chosen.

    Attributes:
        motor: At every chip.
        mux: Address of the multiplexer; None: the chip is on the bus itself.
        channels: Of the multiplexer, in order; empty without one.
        enable: The board's pin that the chips' EN is wired to; None: none.
        calibrations: One for each chip.
    """

    motor: Motor
    mux: int | None
    channels: tuple[int, ...]
    enable: int | None
    calibrations: tuple[AutoCalibration, ...]

    def calibrated(self, results: tuple[AutoCalibration, ...]) -> "DriverOptions":
        """Return the same with other calibrations."""
        return replace(self, calibrations=results)


def driver_options(texts: dict[str, str], name: str) -> DriverOptions:
    """Read the options: of the motor, which chips there are, and what is known of them.

    Args:
        texts: Each option that is given.
        name: The device, for errors.

    Raises:
        BadInput: If one is not valid.
    """
    motor = _motor(texts, name)
    mux, channels = _place(texts, name)
    count = max(len(channels), 1)
    calibrations = tuple(AutoCalibration() for _ in range(count))
    if text := texts.get("calibration"):
        calibrations = tuple(_calibration(part, name) for part in text.split(","))
        if len(calibrations) != count:
            raise BadInput(
                f"found {len(calibrations)} calibrations for {count} chips; give one for each", name
            )
    enable = whole_number(texts["enable"], "enable", name, range(128)) if "enable" in texts else None
    return DriverOptions(motor, mux, channels, enable, calibrations)


def _motor(texts: dict[str, str], name: str) -> Motor:
    kind: Any = texts.get("motor")
    if kind not in ("lra", "erm"):
        raise BadInput(
            f"found motor={kind or ''}; give motor=lra (linear resonant actuator) or motor=erm (eccentric "
            "rotating mass), and its rated voltage: ?motor=lra&rated_v=1.8",
            name,
        )
    if kind == "erm" and "hz" in texts:
        raise BadInput("hz is the resonance of an LRA; an ERM has none", name)
    resonance_hz = _number(texts, "hz", RESONANCE_HZ, name, LOWEST_HZ, HIGHEST_HZ)
    motor = Motor(kind, _number(texts, "rated_v", RATED_V, name, 0.1, 5.2), 0.0, resonance_hz)
    clamp_v = _number(texts, "clamp_v", motor.peak_v, name, 0.1, 5.2)
    motor = replace(motor, clamp_v=clamp_v)
    if clamp_v < motor.peak_v - 0.005:
        raise BadInput(
            f"found clamp_v={clamp_v:g}; a peak below {motor.peak_v:.2f} V would not allow the rated voltage",
            name,
        )
    if not motor.fits:
        raise BadInput(f"the DRV2605L cannot drive {motor.rated_v:g} V with a peak of {clamp_v:g} V", name)
    return motor


def _place(texts: dict[str, str], name: str) -> tuple[int | None, tuple[int, ...]]:
    """Return the multiplexer's address and the channels."""
    if ("mux" in texts) != ("channel" in texts):
        raise BadInput(
            "every DRV2605L has the address 0x5A, so several need a multiplexer, TCA9548A: give its address "
            "and the channels, mux=0x70&channel=0,1"
            if "channel" in texts
            else "a multiplexer needs the channels of the chips: mux=0x70&channel=0,1",
            name,
        )
    if "mux" not in texts:
        return None, ()
    channels = tuple(whole_number(text, "channel", name, range(8)) for text in texts["channel"].split(","))
    if len(set(channels)) < len(channels):
        raise BadInput(f"found channel={texts['channel']}; name each channel once", name)
    return whole_number(texts["mux"], "mux", name, range(0x70, 0x78)), channels


def _calibration(text: str, name: str) -> AutoCalibration:
    parts = text.split("-")
    numbers = [int(part) for part in parts if part.isdecimal()]
    if len(parts) != 3 or len(numbers) != 3 or max(numbers) > BYTE or numbers[2] > MAX_GAIN:
        raise BadInput(
            f"found calibration={text}; valid: three numbers as `haptigraph devices auto-calibrate` prints "
            "them, 12-108-2",
            name,
        )
    return AutoCalibration(*numbers)


def _number(
    texts: dict[str, str], key: str, default: float, name: str, lowest: float, highest: float
) -> float:
    text = texts.get(key)
    if text is None:
        return default
    try:
        number = float(text)
    except ValueError:
        number = lowest - 1
    if not lowest <= number <= highest:
        raise BadInput(f"found {key}={text}; valid: {lowest:g} to {highest:g}", name)
    return number
