"""A board with Firmata on a serial port, and what all devices on one share.

Protocol: github.com/firmata/protocol, version 2.5. A board and the chips on it hold their last output
forever, so `run_device` runs these devices in a watchdog process.
"""

import os
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any
from urllib.parse import parse_qsl

from haptigraph.errors import BadInput, DeviceError, MissingExtra

__all__ = [
    "RESPONSE_S",
    "SETUP_S",
    "BoardDevice",
    "FirmataBoard",
    "baud_rate",
    "ports_found",
    "split_argument",
    "sysex",
    "whole_number",
]

SYSEX, END, VERSION, SET_PIN_MODE = 0xF0, 0xF7, 0xF9, 0xF4
FIRMWARE, CAPABILITY_QUERY, CAPABILITIES, STATE_QUERY, STATE = 0x79, 0x6B, 0x6C, 0x6D, 0x6E

BOOT_S = 6.0  # an Arduino restarts when its port is opened, and waits two seconds for a new sketch
RETRY_S = 0.5
SETUP_S = 2.0  # a Mega sends 700 bytes, and before anything vibrates a busy machine may be slow
RESPONSE_S = 0.1  # 20 bytes at 57,600 baud take 4 ms
BAUD = 57_600


class FirmataBoard:
    """Messages to and from a board.

    Args:
        kind: The device's name in errors about a missing extra.
        port: The serial port.
        baud: Its rate.
        silence: The bytes that silence everything on the board, the last before the port is closed.
        first: The first when it is opened; a board that is just starting may miss some.
    """

    def __init__(self, kind: str, port: str, baud: int, *, silence: bytes, first: bytes) -> None:
        self.port = port
        self._kind, self._baud, self._silence, self._first = kind, baud, silence, first
        self._serial: Any = None

    @property
    def is_open(self) -> bool:
        """Whether the port is open and the board has answered."""
        return self._serial is not None

    def open(self) -> None:
        """Open the port, send the first bytes, wait until the board answers.

        Raises:
            DeviceError: If the port cannot be opened, or nothing on it speaks Firmata.
            MissingExtra: If pyserial is not installed.
        """
        try:
            import serial  # noqa: PLC0415 - an extra
        except ModuleNotFoundError:
            raise MissingExtra(f"device {self._kind}", "serial") from None
        try:
            self._serial = serial.Serial(
                self.port, self._baud, timeout=RETRY_S, write_timeout=SETUP_S, exclusive=True
            )
        except (OSError, ValueError) as error:
            number = getattr(error, "errno", None)
            reason = os.strerror(number) if number else error
            raise DeviceError(f"{self.port} cannot be opened ({reason})") from None
        self._serial.write(self._first)
        self._await_answer()

    def expect_quick_answers(self) -> None:
        """End the patience of the set-up: from now on, messages are commands to an actuator."""
        self._serial.write_timeout = RESPONSE_S

    def close(self) -> None:
        """Silence the board, even if it does not respond, and release the port."""
        port, self._serial = self._serial, None
        if port is not None:
            with suppress(OSError):
                port.write(self._silence)
            with suppress(OSError):
                port.close()

    def send(self, *message: int) -> None:
        """Send bytes."""
        self._serial.write(bytes(message))

    def send_sysex(self, *message: int) -> None:
        """Send a system message."""
        self.send(*sysex(*message))

    def received(self, kinds: bytes, within_s: float) -> bytes | None:
        """Return the next system message of some kinds, its kind first; None if none arrives in time."""
        give_up_s = time.monotonic() + within_s
        while (left_s := give_up_s - time.monotonic()) > 0:
            self._serial.timeout = left_s
            _, start, message = self._serial.read_until(bytes((END,))).rpartition(bytes((SYSEX,)))
            if start and message[:1] in [bytes((kind,)) for kind in kinds] and message[-1] == END:
                return bytes(message[:-1])
        return None

    def modes_of_pins(self) -> list[dict[int, int]]:
        """Return the modes of every pin, each with its resolution in bits.

        Raises:
            DeviceError: If the board does not answer.
        """
        self.send_sysex(CAPABILITY_QUERY)
        response = self.received(bytes((CAPABILITIES,)), SETUP_S)
        if response is None:
            raise DeviceError(f"the board on {self.port} does not report the capabilities of its pins")
        return [dict(zip(modes[::2], modes[1::2], strict=False)) for modes in response[1:].split(b"\x7f")]

    def state_of_pin(self, pin: int, within_s: float) -> bytes | None:
        """Return a pin, its mode and its value in parts of seven bits; None if no answer comes in time."""
        self.send_sysex(STATE_QUERY, pin)
        response = self.received(bytes((STATE,)), within_s)
        return None if response is None else response[1:]

    def set_pin_mode(self, pin: int, mode: int) -> None:
        """Set the mode of a pin."""
        self.send(SET_PIN_MODE, pin, mode)

    def is_lost(self, error: OSError) -> str:
        """Say that the port is lost."""
        return f"{self.port} is lost ({error.strerror or error})"

    @contextmanager
    def closed_on_failure(self) -> Iterator[None]:
        """Close the board if anything fails, so that it is silenced now and set up again next time.

        Raises:
            DeviceError: As raised inside, or if the port is lost.
        """
        try:
            yield
        except OSError as error:  # includes the errors of pyserial
            self.close()
            raise DeviceError(self.is_lost(error)) from None
        except BaseException:
            self.close()
            raise

    def _await_answer(self) -> None:
        """Query the name of the firmware until the board sends it."""
        give_up_s = time.monotonic() + BOOT_S
        while time.monotonic() < give_up_s:
            self.send(VERSION)
            self.send_sysex(FIRMWARE)
            if self.received(bytes((FIRMWARE,)), RETRY_S) is not None:
                return
        raise DeviceError(
            f"nothing on {self.port} answers as Firmata at {self._baud} baud; upload the sketch "
            "StandardFirmata (Arduino IDE: File, Examples, Firmata), or give another rate: ?baud=115200"
        )


class BoardDevice(ABC):
    """A device on a board: it is set up again after every failure, and silent in between.

    Args:
        name: The device as the user named it, for errors.
        board: The board.

    Raises:
        BadInput: If the device cannot be set up.
        MissingExtra: If pyserial is not installed.
    """

    def __init__(self, name: str, board: FirmataBoard) -> None:
        self._board = board
        self._closed = False
        try:
            with board.closed_on_failure():
                self._connect()
        except DeviceError as error:
            raise BadInput(str(error), name) from None

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Set the amplitude, and verify that it was applied."""
        with self._board.closed_on_failure():
            if not self._board.is_open:
                self._connect()
            self._apply(amplitude, RESPONSE_S)

    def close(self) -> None:
        """Silence the device and release the port.

        Raises:
            DeviceError: If silence was not confirmed.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self.set(0.0, 0.0, 0)
        finally:
            self._board.close()

    def _connect(self) -> None:
        self._board.open()
        self._set_up()
        self._apply(0.0, SETUP_S)
        self._board.expect_quick_answers()

    @abstractmethod
    def _set_up(self) -> None:
        """Prepare the actuators of a board that has just answered."""

    @abstractmethod
    def _apply(self, amplitude: float, within_s: float) -> None:
        """Set the amplitude, and verify within a time that it was applied."""


def ports_found(kind: str, options: str = "") -> dict[str, str]:
    """Return the serial ports of this machine: the device argument and the product name of each."""
    try:
        from serial.tools import list_ports  # noqa: PLC0415 - an extra
    except ModuleNotFoundError:
        raise MissingExtra(f"device {kind}", "serial") from None
    return {
        f"{kind}:{port.device}{options}": port.product or "nothing says what is on it"
        for port in list_ports.comports()
    }


def split_argument(kind: str, argument: str, valid: str) -> tuple[str, dict[str, str]]:
    """Split PORT?OPTION=VALUE&OPTION=VALUE.

    Args:
        kind: The device.
        argument: The text after "KIND:".
        valid: All options, as text to the user: "pin=N&baud=N".

    Returns:
        The port and the options that are given.

    Raises:
        BadInput: If there is no port, or another option.
    """
    port, _, query = argument.partition("?")
    options = dict(parse_qsl(query, keep_blank_values=True))
    names = {option.partition("=")[0] for option in valid.split("&")}
    for key, text in options.items():
        if key not in names:
            raise BadInput(f"found {key}={text}; valid after the port: ?{valid}", f"{kind}:{argument}")
    if not port:
        raise BadInput(
            f"no port is given; use {kind}:/dev/ttyACM0?{valid} (`haptigraph devices` lists the ports)", kind
        )
    return port, options


def whole_number(text: str, key: str, place: str, valid: range) -> int:
    """Return the value of an option, decimal or 0x...

    Raises:
        BadInput: If it is not a number, or out of range.
    """
    try:
        number = int(text, 0)
    except ValueError:
        number = valid.start - 1
    if number not in valid:
        show = hex if text.startswith("0x") else str
        raise BadInput(f"found {key}={text}; valid: {show(valid.start)} to {show(valid.stop - 1)}", place)
    return number


def baud_rate(options: dict[str, str], place: str) -> int:
    """Return the option `baud`, or that of StandardFirmata.

    Raises:
        BadInput: If it is not valid.
    """
    return whole_number(options.get("baud", str(BAUD)), "baud", place, range(300, 4_000_000))


def sysex(*message: int) -> tuple[int, ...]:
    """Return a system message."""
    return SYSEX, *message, END
