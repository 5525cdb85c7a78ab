"""Drive a motor from any Arduino or ESP32 with the stock sketch StandardFirmata: one PWM pin over serial.

Protocol: github.com/firmata/protocol, version 2.5. After every command the device queries the pin's state, so
that it detects at once a board that hangs, was reset or lost power. The board holds its last output forever,
so `assemble` runs this device in a watchdog process.
"""

import os
import time
from contextlib import suppress
from typing import Any
from urllib.parse import parse_qsl

from msgspec.structs import replace

from haptigraph.errors import BadInput, DeviceError, MissingExtra
from haptigraph.messages import Capabilities

__all__ = ["FirmataDevice"]

END, VERSION, SYSEX, SET_PIN_MODE, ANALOG = b"\xf7", b"\xf9", 0xF0, 0xF4, 0xE0
FIRMWARE, CAPABILITY_QUERY, CAPABILITIES, STATE_QUERY, STATE, EXTENDED_ANALOG = (
    0x79,
    0x6B,
    0x6C,
    0x6D,
    0x6E,
    0x6F,
)
PWM = 3
MAX_BITS = 16

BOOT_S = 6.0  # an Arduino restarts when its port is opened, and waits two seconds for a new sketch
RETRY_S = 0.5
SETUP_S = 2.0  # a Mega sends 700 bytes, and before anything vibrates a busy machine may be slow
RESPONSE_S = 0.1  # 20 bytes at 57,600 baud take 4 ms
OPTIONS = {"pin": 9, "baud": 57_600}


class FirmataDevice:
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
        self._port, self._pin, self._baud = _parsed(argument)
        self._serial: Any = None
        self._closed = False
        self._max_value = 0
        try:
            self._connect()
        except DeviceError as error:
            raise BadInput(str(error), f"serial:{argument}") from None
        except OSError as error:
            raise BadInput(self._lost(error), f"serial:{argument}") from None
        self.capabilities = replace(self.capabilities, amplitude_levels=self._max_value)

    @staticmethod
    def found() -> dict[str, str]:
        """Return the serial ports of this machine: the device argument and the product name of each."""
        try:
            from serial.tools import list_ports  # noqa: PLC0415 - an extra
        except ModuleNotFoundError:
            raise MissingExtra("device serial", "serial") from None
        return {f"serial:{port.device}": port.product or "serial port" for port in list_ports.comports()}

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Set the pin's duty cycle, and verify that the board applied it."""
        try:
            if self._serial is None:
                self._connect()
            self._write(round(amplitude * self._max_value), RESPONSE_S)
        except DeviceError:
            self._disconnect()
            raise
        except OSError as error:  # includes the errors of pyserial
            self._disconnect()
            raise DeviceError(self._lost(error)) from None

    def close(self) -> None:
        """Set the pin to 0 and release the port.

        Raises:
            DeviceError: If the board did not confirm it.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self.set(0.0, 0.0, 0)
        finally:
            self._disconnect()

    def _connect(self) -> None:
        """Open the port, silence the pin, wait for the board, query its capabilities."""
        try:
            import serial  # noqa: PLC0415 - an extra
        except ModuleNotFoundError:
            raise MissingExtra("device serial", "serial") from None
        try:
            self._serial = serial.Serial(
                self._port, self._baud, timeout=RETRY_S, write_timeout=SETUP_S, exclusive=True
            )
        except (OSError, ValueError) as error:
            number = getattr(error, "errno", None)
            reason = os.strerror(number) if number else error
            raise DeviceError(f"{self._port} cannot be opened ({reason})") from None
        try:
            self._send(*_analog(self._pin, 0))  # it may still vibrate from an earlier run
            self._await_board()
            self._send(SET_PIN_MODE, self._pin, PWM)
            self._max_value = self._query_max_value()
            self._write(0, SETUP_S)
            self._serial.write_timeout = RESPONSE_S
        except BaseException:
            self._disconnect()
            raise

    def _await_board(self) -> None:
        """Query the name of the firmware until the board sends it."""
        give_up_s = time.monotonic() + BOOT_S
        while time.monotonic() < give_up_s:
            self._serial.write(VERSION)
            self._send_sysex(FIRMWARE)
            if self._response(FIRMWARE, RETRY_S) is not None:
                return
        raise DeviceError(
            f"nothing on {self._port} answers as Firmata at {self._baud} baud; upload the sketch "
            "StandardFirmata (Arduino IDE: File, Examples, Firmata), or give another rate: ?baud=115200"
        )

    def _query_max_value(self) -> int:
        """Return the maximum value of the pin."""
        self._send_sysex(CAPABILITY_QUERY)
        response = self._response(CAPABILITIES, SETUP_S)
        if response is None:
            raise DeviceError(f"the board on {self._port} does not report the capabilities of its pins")
        pins = [dict(zip(modes[::2], modes[1::2], strict=False)) for modes in response.split(b"\x7f")]
        valid = [number for number, modes in enumerate(pins) if PWM in modes]
        if self._pin not in valid:
            remedy = f"use one of {', '.join(map(str, valid))}" if valid else "none of this board does"
            raise DeviceError(f"pin {self._pin} does not support PWM; {remedy}")
        bits = pins[self._pin][PWM]
        if not 1 <= bits <= MAX_BITS:
            raise DeviceError(f"pin {self._pin} reports a PWM of {bits} bits; valid: 1 to {MAX_BITS}")
        return (1 << bits) - 1

    def _write(self, value: int, within_s: float) -> None:
        """Set the pin and query its state."""
        self._send(*_analog(self._pin, value))
        self._send_sysex(STATE_QUERY, self._pin)
        response = self._response(STATE, within_s)
        if response is None:
            raise DeviceError(f"the board on {self._port} does not respond")
        reported = sum(bit << 7 * index for index, bit in enumerate(response[2:]))
        if len(response) < 3:
            raise DeviceError(f"the board on {self._port} sends a response without content")
        if (*response[:2], reported) != (self._pin, PWM, value):
            raise DeviceError(
                f"the board on {self._port} was reset: its pin is not at the value that was set"
            )

    def _response(self, command: int, within_s: float) -> bytes | None:
        """Return the content of the next system message of a kind, None if none arrives in time."""
        give_up_s = time.monotonic() + within_s
        while (left_s := give_up_s - time.monotonic()) > 0:
            self._serial.timeout = left_s
            _, start, message = self._serial.read_until(END).rpartition(bytes((SYSEX,)))
            if start and message[:1] == bytes((command,)) and message.endswith(END):
                return bytes(message[1:-1])
        return None

    def _send_sysex(self, *message: int) -> None:
        self._send(SYSEX, *message, END[0])

    def _send(self, *message: int) -> None:
        self._serial.write(bytes(message))

    def _lost(self, error: OSError) -> str:
        return f"{self._port} is lost ({error.strerror or error})"

    def _disconnect(self) -> None:
        """Silence the pin, even if the board does not respond, and release the port."""
        port, self._serial = self._serial, None
        if port is not None:
            with suppress(OSError):
                port.write(bytes(_analog(self._pin, 0)))
            with suppress(OSError):
                port.close()


def _parsed(argument: str) -> tuple[str, int, int]:
    """Return port, pin and baud rate of the text after "serial:"."""
    port, _, query = argument.partition("?")
    values = {**OPTIONS}
    for key, text in parse_qsl(query, keep_blank_values=True):
        if key not in OPTIONS or not text.isdecimal():
            raise BadInput(f"found {key}={text}; valid after the port: ?pin=N&baud=N", f"serial:{argument}")
        values[key] = int(text)
    if not port:
        raise BadInput(
            "no port is given; use serial:/dev/ttyACM0?pin=9 (`haptigraph devices` lists the ports)", "serial"
        )
    if values["pin"] > 127:
        raise BadInput(f"pin {values['pin']} does not exist; Firmata has pins 0 to 127", f"serial:{argument}")
    return port, values["pin"], values["baud"]


def _analog(pin: int, value: int) -> tuple[int, ...]:
    """Return the message that sets a pin: the short form if pin and value fit."""
    if pin < 16 and value < 1 << 14:
        return ANALOG | pin, value & 0x7F, value >> 7
    return SYSEX, EXTENDED_ANALOG, pin, *(value >> place & 0x7F for place in range(0, 28, 7)), END[0]
