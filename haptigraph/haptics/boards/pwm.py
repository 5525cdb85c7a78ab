"""Drive a motor from any Arduino or ESP32 with the stock sketch StandardFirmata: one PWM pin over serial.

After every command the device queries the pin's state, so that it detects at once a board that hangs, was
reset or lost power.
"""

from msgspec.structs import replace

from haptigraph.errors import DeviceError
from haptigraph.haptics.boards.board import (
    BoardDevice,
    FirmataBoard,
    baud_rate,
    ports_found,
    split_argument,
    sysex,
    whole_number,
)
from haptigraph.messages import Capabilities

__all__ = ["PwmDevice"]

ANALOG, EXTENDED_ANALOG = 0xE0, 0x6F
PWM = 3
MAX_BITS = 16
OPTIONS = "pin=N&baud=N"


class PwmDevice(BoardDevice):
    """Set a PWM pin of a board.

    Args:
        argument: PORT?pin=N&baud=N, for example /dev/ttyACM0?pin=9; pin 9 and 57,600 baud if not given.

    Raises:
        BadInput: If the port cannot be used, nothing on it speaks Firmata, or the pin does not support PWM.
        MissingExtra: If pyserial is not installed.
    """

    capabilities = Capabilities(
        amplitude_levels=255,
        frequency_range_hz=None,
        shortest_on_ms=50.0,
        answers=True,
        limitations="A motor spins faster at higher amplitude; its frequency cannot be chosen.",
    )

    def __init__(self, argument: str) -> None:
        name = f"serial:{argument}"
        port, options = split_argument("serial", argument, OPTIONS)
        self._pin = whole_number(options.get("pin", "9"), "pin", name, range(128))
        baud = baud_rate(options, name)
        self._max_value = 0
        silence = bytes(_analog(self._pin, 0))  # at once: it may still vibrate from an earlier run
        super().__init__(name, FirmataBoard("serial", port, baud, silence=silence, first=silence))
        self.capabilities = replace(self.capabilities, amplitude_levels=self._max_value)

    @staticmethod
    def found() -> dict[str, str]:
        """Return the serial ports of this machine, whatever is on them."""
        return ports_found("serial")

    def _set_up(self) -> None:
        """Set the pin's mode, query its resolution."""
        self._board.set_pin_mode(self._pin, PWM)
        self._max_value = self._query_max_value()

    def _query_max_value(self) -> int:
        """Return the maximum value of the pin."""
        pins = self._board.modes_of_pins()
        valid = [number for number, modes in enumerate(pins) if PWM in modes]
        if self._pin not in valid:
            remedy = f"use one of {', '.join(map(str, valid))}" if valid else "none of this board does"
            raise DeviceError(f"pin {self._pin} does not support PWM; {remedy}")
        bits = pins[self._pin][PWM]
        if not 1 <= bits <= MAX_BITS:
            raise DeviceError(f"pin {self._pin} reports a PWM of {bits} bits; valid: 1 to {MAX_BITS}")
        return (1 << bits) - 1

    def _apply(self, amplitude: float, within_s: float) -> None:
        """Set the pin's duty cycle and query its state."""
        value, port = round(amplitude * self._max_value), self._board.port
        self._board.send(*_analog(self._pin, value))
        state = self._board.state_of_pin(self._pin, within_s)
        if state is None:
            raise DeviceError(f"the board on {port} does not respond")
        if len(state) < 3:
            raise DeviceError(f"the board on {port} sends a response without content")
        reported = sum(bits << 7 * index for index, bits in enumerate(state[2:]))
        if (*state[:2], reported) != (self._pin, PWM, value):
            raise DeviceError(f"the board on {port} was reset: its pin is not at the value that was set")


def _analog(pin: int, value: int) -> tuple[int, ...]:
    """Return the message that sets a pin: the short form if pin and value fit."""
    if pin < 16 and value < 1 << 14:
        return ANALOG | pin, value & 0x7F, value >> 7
    return sysex(EXTENDED_ANALOG, pin, *(value >> place & 0x7F for place in range(0, 28, 7)))
