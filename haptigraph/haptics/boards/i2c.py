"""The I2C bus of a board with Firmata, and a multiplexer on it.

Protocol: github.com/firmata/protocol, i2c.md. StandardFirmata confirms no write. It answers a read that no
chip acknowledges with a sentence, and then with the bytes of an earlier read; so the sentence counts.
"""

from haptigraph.errors import DeviceError
from haptigraph.haptics.boards.board import FirmataBoard, sysex

__all__ = ["ENABLE_MESSAGE", "I2cBus", "Multiplexer", "channel_mask", "write_message"]

REQUEST, REPLY, CONFIG, STRING = 0x76, 0x77, 0x78, 0x71
READ_ONCE = 0x08
I2C_MODE = 6
ENABLE_MESSAGE = sysex(CONFIG, 0, 0)
"""Turns the pins over to the bus, without a delay of reads: before it, a read or write may hang the board."""


class I2cBus:
    """Read and write the registers of the chips on a bus.

    Args:
        board: The board.
    """

    def __init__(self, board: FirmataBoard) -> None:
        self._board = board

    def verify_pins(self) -> None:
        """Check that the board has pins for I2C.

        Raises:
            DeviceError: If the board has none.
        """
        if not any(I2C_MODE in modes for modes in self._board.modes_of_pins()):
            raise DeviceError(
                f"the board on {self._board.port} has no pins for I2C; use one that StandardFirmata supports"
            )

    def write(self, address: int, *data: int) -> None:
        """Write bytes, usually a register's number and then its value and those of the next ones."""
        self._board.send(*write_message(address, *data))

    def request(self, address: int, register: int | None, count: int) -> None:
        """Ask for registers; the answers come in the order of the requests.

        Args:
            address: Of the chip.
            register: The first one; None: the chip has only one, without a number.
            count: How many.
        """
        numbers = (count,) if register is None else (register, count)
        self._board.send_sysex(REQUEST, address, READ_ONCE, *_sevens(numbers))

    def answer(self, address: int, register: int | None, count: int, within_s: float) -> bytes:
        """Return the registers that were requested with the same numbers.

        Raises:
            DeviceError: If the chip or the board does not answer in time.
        """
        while True:
            answer = self._board.received(bytes((REPLY, STRING)), within_s)
            if answer is None:
                raise DeviceError(f"the board on {self._board.port} does not respond")
            content = bytes(
                low | high << 7 & 0xFF for low, high in zip(answer[1::2], answer[2::2], strict=False)
            )
            if answer[0] == STRING:
                text = content.decode("ascii", "replace")
                raise DeviceError(f"nothing answers at the I2C address {address:#04x} ({text})")
            if content[:2] == bytes((address, register or 0)) and len(content) == count + 2:
                return content[2:]
            if content[:2] == bytes((address, register or 0)):
                raise DeviceError(f"the board on {self._board.port} sends a response without content")

    def read(self, address: int, register: int | None, count: int, within_s: float) -> bytes:
        """Request registers and return them.

        Raises:
            DeviceError: If the chip or the board does not answer in time.
        """
        self.request(address, register, count)
        return self.answer(address, register, count, within_s)


class Multiplexer:
    """A TCA9548A (SCPS207G): each bit of its only register connects a channel; several may be connected.

    Args:
        bus: The bus that it is on.
        address: Its address, 0x70 to 0x77.
    """

    def __init__(self, bus: I2cBus, address: int) -> None:
        self._bus, self._address = bus, address

    def connect(self, channels: tuple[int, ...]) -> None:
        """Connect some channels and disconnect all others."""
        self._bus.write(self._address, channel_mask(channels))

    def request(self) -> None:
        """Ask which channels are connected, for `verify`."""
        self._bus.request(self._address, None, 1)

    def verify(self, channels: tuple[int, ...], within_s: float) -> None:
        """Check which channels were connected at the request.

        Raises:
            DeviceError: If they are others: then a command may have reached another chip.
        """
        (mask,) = self._bus.answer(self._address, None, 1, within_s)
        if mask != channel_mask(channels):
            connected = ", ".join(str(channel) for channel in range(8) if mask >> channel & 1) or "none"
            raise DeviceError(
                f"the multiplexer at {self._address:#04x} does not switch to channel "
                f"{', '.join(map(str, channels))}; connected: {connected}"
            )


def write_message(address: int, *data: int) -> tuple[int, ...]:
    """Return the message that writes bytes to a chip."""
    return sysex(REQUEST, address, 0, *_sevens(data))


def channel_mask(channels: tuple[int, ...]) -> int:
    """Return the byte that connects some channels of a multiplexer."""
    return sum(1 << channel for channel in channels)


def _sevens(data: tuple[int, ...]) -> tuple[int, ...]:
    """Split each byte into its lower seven bits and the eighth."""
    return tuple(part for byte in data for part in (byte & 0x7F, byte >> 7))
