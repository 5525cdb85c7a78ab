"""Drive LRAs or ERMs with DRV2605L haptic drivers on the I2C bus of a board with the sketch StandardFirmata.

A driver plays an amplitude in real time; decision 0059 says why not an effect of its library. After every
command the device reads back what each chip plays.
"""

import time
from collections.abc import Iterable

from haptigraph.errors import DeviceError
from haptigraph.haptics.boards.board import (
    RESPONSE_S,
    SETUP_S,
    BoardDevice,
    FirmataBoard,
    baud_rate,
    ports_found,
    split_argument,
)
from haptigraph.haptics.boards.chip import (
    AutoCalibration,
    Chip,
    amplitude_command,
    standby_commands,
)
from haptigraph.haptics.boards.driver_options import OPTIONS, DriverOptions, driver_options
from haptigraph.haptics.boards.i2c import ENABLE_MESSAGE, I2cBus, Multiplexer, channel_mask, write_message
from haptigraph.messages import Capabilities

__all__ = ["Drv2605Device"]

OUTPUT, DIGITAL_PORT = 1, 0x90
MAX_VALUE = 255
AT_ONCE = 2  # chips that are asked before the first answer: 62 bytes, an Uno has a buffer for 64
RETRY_S = 1.0  # a chip that is enabled but not reached may vibrate until it is disabled again


class Drv2605Device(BoardDevice):
    """Play on one DRV2605L, or on several behind a multiplexer, all alike.

    Args:
        argument: PORT?motor=lra, with the options of `driver_options`, for example
            /dev/ttyACM0?motor=lra&mux=0x70&channel=0,1.

    Raises:
        BadInput: If an option is not valid, or port, multiplexer or chip cannot be used.
        MissingExtra: If pyserial is not installed.
    """

    capabilities = Capabilities(
        amplitude_levels=MAX_VALUE,
        frequency_range_hz=None,
        shortest_on_ms=50.0,
        answers=True,
        limitations="An LRA vibrates at its resonance; an ERM spins faster at higher amplitude.",
    )

    def __init__(self, argument: str) -> None:
        name = f"drv2605:{argument}"
        port, texts = split_argument("drv2605", argument, OPTIONS)
        self._options = options = driver_options(texts, name)
        baud = baud_rate(texts, name)
        disable = _enable(options, 0)
        silence = bytes((*_standby(options), *disable))
        board = FirmataBoard("drv2605", port, baud, silence=silence, first=bytes(disable))
        self._bus = I2cBus(board)
        self._multiplexer = None if options.mux is None else Multiplexer(self._bus, options.mux)
        self._chips = {
            channels: Chip(self._bus, options.motor, _name(channels)) for channels in _each(options.channels)
        }
        self._retry_s = 0.0
        super().__init__(name, board)

    @staticmethod
    def found() -> dict[str, str]:
        """Return the serial ports of this machine, whatever is on them."""
        return ports_found("drv2605", "?motor=lra")

    def calibrate(self) -> tuple[AutoCalibration, ...]:
        """Let each chip measure its motor, which vibrates for about a second; then the device is silent.

        The device uses the results until it is closed; the option `calibration` restores
        `AutoCalibration.text`. Meanwhile the motor must be mounted, and held, as in use.

        Raises:
            DeviceError: If a measurement fails.
        """
        with self._board.closed_on_failure():
            if not self._board.is_open:
                self._connect()
            results = []
            for channels, chip in self._chips.items():
                self._select(channels, SETUP_S)
                results.append(chip.calibrate())
                chip.set_up(results[-1])
            self._options = self._options.calibrated(tuple(results))
            self._apply(0.0, RESPONSE_S)
        return tuple(results)

    def _connect(self) -> None:
        if time.monotonic() < self._retry_s and not self._closed:
            raise DeviceError(
                f"the chips on {self._board.port} cannot be reached; they are tried once a second"
            )
        if self._options.enable is not None:
            self._retry_s = time.monotonic() + RETRY_S
        super()._connect()
        self._retry_s = 0.0

    def _set_up(self) -> None:
        """Enable the bus, then the chips, once it is certain which of them a command reaches."""
        self._bus.verify_pins()  # by its answer, the board has read all earlier messages
        self._board.send(*_standby(self._options))
        for channels in self._chips:
            self._select(channels, SETUP_S)
        if (pin := self._options.enable) is not None:
            self._board.set_pin_mode(pin, OUTPUT)
            self._board.send(*_enable(self._options, 1), *_standby(self._options))
        for (channels, chip), calibration in zip(
            self._chips.items(), self._options.calibrations, strict=True
        ):
            self._select(channels, SETUP_S)
            chip.set_up(calibration)

    def _apply(self, amplitude: float, within_s: float) -> None:
        """Set all chips at once, then read back each."""
        value = round(amplitude * MAX_VALUE)
        if self._multiplexer:
            self._multiplexer.connect(self._options.channels)
        self._bus.write(*amplitude_command(value))
        chips = list(self._chips.items())
        for some in (chips[first : first + AT_ONCE] for first in range(0, len(chips), AT_ONCE)):
            for channels, chip in some:
                self._connect_channels(channels)
                chip.request()
            for channels, chip in some:
                self._verify_channels(channels, within_s)
                chip.verify(value, within_s)
        pin = self._options.enable  # a chip that is not enabled may answer all the same
        if pin is not None and self._board.state_of_pin(pin, within_s) != bytes((pin, OUTPUT, 1)):
            raise DeviceError(
                f"the board on {self._board.port} does not hold pin {pin} high, which enables the chips"
            )

    def _select(self, channels: tuple[int, ...], within_s: float) -> None:
        self._connect_channels(channels)
        self._verify_channels(channels, within_s)

    def _connect_channels(self, channels: tuple[int, ...]) -> None:
        if self._multiplexer:
            self._multiplexer.connect(channels)
            self._multiplexer.request()

    def _verify_channels(self, channels: tuple[int, ...], within_s: float) -> None:
        if self._multiplexer:
            self._multiplexer.verify(channels, within_s)


def _each(channels: tuple[int, ...]) -> Iterable[tuple[int, ...]]:
    """Return the channels of each chip: one, or none without a multiplexer."""
    return [(channel,) for channel in channels] or [()]


def _name(channels: tuple[int, ...]) -> str:
    return f"the driver on channel {channels[0]}" if channels else "the driver"


def _standby(options: DriverOptions) -> tuple[int, ...]:
    """Return the messages that silence all chips in any state.

    They are for a board that has answered: a message to the bus that is not enabled hangs the sketch.
    """
    select = () if options.mux is None else write_message(options.mux, channel_mask(options.channels))
    return (
        *ENABLE_MESSAGE,
        *select,
        *(byte for command in standby_commands() for byte in write_message(*command)),
    )


def _enable(options: DriverOptions, level: int) -> tuple[int, ...]:
    """Return the message that sets the chips' EN, and other outputs of its port to 0; empty without EN."""
    if options.enable is None:
        return ()
    port, bit = divmod(options.enable, 8)
    value = level << bit
    return DIGITAL_PORT | port, value & 0x7F, value >> 7
