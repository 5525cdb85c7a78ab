"""DRV2605L drivers behind a TCA9548A, simulated at the level of their registers, on the I2C bus of a simulated board.

Written for tests from the documents of the chips alone (Texas Instruments, SLOS854D and SCPS207G); it shares no code
with the device under test. Like StandardFirmata, the board answers a read that is not acknowledged with a sentence,
and then with what an earlier read left in its buffer.
"""

import threading
import time
from collections.abc import Callable

from firmata_board import Board

RESET = {0x00: 0xE0, 0x01: 0x40, 0x03: 0x01, 0x04: 0x01, 0x11: 0x05, 0x12: 0x19, 0x13: 0xFF, 0x14: 0x19, 0x15: 0xFF,
         0x16: 0x3E, 0x17: 0x8C, 0x18: 0x0C, 0x19: 0x6C, 0x1A: 0x36, 0x1B: 0x93, 0x1C: 0xF5, 0x1D: 0xA0, 0x1E: 0x20,
         0x1F: 0x80, 0x20: 0x33}  # fmt: skip
COUNT = 0x23
STATUS, MODE, RTP, GO, RATED, COMPENSATION, FEEDBACK, CONTROL2, CONTROL3 = (
    0,
    1,
    2,
    0x0C,
    0x16,
    0x18,
    0x1A,
    0x1C,
    0x1D,
)
CALIBRATION_S = 0.2  # instead of 1.0 to 1.2 s


class Drv2605l:
    """A haptic driver; `output` is the share of the rated voltage that its motor gets, 0 to 1.

    Attributes:
        answers: Whether it acknowledges its address. If not, it goes on with what it does.
        enabled: The level of its pin EN.
        has_motor: Whether a motor is found at its output by a calibration.
    """

    def __init__(self, on_change=lambda: None, device_id=7):
        self.on_change, self.device_id = on_change, device_id
        self.answers = self.enabled = self.has_motor = self.has_power = True
        self.is_faulty = 0  # bits of over-temperature and over-current
        self.calibrations = []  # registers 0x16, 0x17, 0x1A to 0x1E of each
        self.timer = None
        self.power_up()

    def power_up(self):
        self.registers = bytearray(COUNT)
        for register, value in RESET.items():
            self.registers[register] = value
        self.registers[STATUS] = self.device_id << 5
        self.pointer = 0
        self.has_power = True
        self.on_change()

    def lose_power(self):
        self.has_power = False
        self.on_change()

    @property
    def output(self):
        mode, control = self.registers[MODE], self.registers[CONTROL3]
        if not (self.has_power and self.enabled) or mode & 0x40:
            return 0.0
        if mode & 7 == 7 and self.registers[GO] & 1:
            return 1.0
        if mode & 7 != 5:
            return 0.0
        value = self.registers[RTP]
        if not control & 0x08:  # signed
            value = value - 256 if value > 127 else value
            return max(value, 0) / 127
        if self.registers[CONTROL2] & 0x80:  # bidirectional: the middle is silence
            return max(value - 127, 0) / 128
        return value / 255

    def is_listening(self):
        return self.answers and self.has_power

    def write(self, data):
        self.pointer = data[0]
        for value in data[1:]:
            if self.pointer == MODE and value & 0x80:
                self.power_up()
            elif self.pointer in (MODE, RTP) or not self.registers[MODE] & 0x40:  # else ignored in standby
                self.registers[self.pointer] = value
            if self.pointer == GO and value & 1 and self.registers[MODE] & 0x47 == 7:
                self.begin_calibration()
            self.pointer = (self.pointer + 1) % COUNT
        self.on_change()

    def read(self, count):
        self.registers[STATUS] |= self.is_faulty
        data = bytes(self.registers[(self.pointer + place) % COUNT] for place in range(count))
        self.registers[STATUS] &= 0xF8
        return data

    def begin_calibration(self):
        self.calibrations.append(bytes((*self.registers[0x16:0x18], *self.registers[0x1A:0x1F])))
        self.timer = threading.Timer(CALIBRATION_S, self.end_calibration)
        self.timer.start()

    def end_calibration(self):
        self.registers[GO] = 0
        self.registers[STATUS] = self.device_id << 5 | (0 if self.has_motor else 8)
        if self.has_motor:
            self.registers[COMPENSATION : COMPENSATION + 2] = 13, 110
            self.registers[FEEDBACK] = self.registers[FEEDBACK] & ~3 | 1
            self.registers[0x22] = 58  # 5.71 ms, 175 Hz
        self.on_change()


class Tca9548a:
    """A multiplexer; `stuck` keeps it from switching."""

    def __init__(self):
        self.mask, self.is_stuck = 0, False

    def write(self, data):
        if not self.is_stuck:
            self.mask = data[-1]

    def read(self, count):
        return bytes([self.mask] * count)

    def is_listening(self):
        return True


class DriverBoard(Board):
    """An Uno with StandardFirmata, and drivers at 0x5A: behind a multiplexer at 0x70, or one on the bus itself.

    Args:
        link: The port.
        channels: The channels of the multiplexer that have a driver; empty: there is no multiplexer.
        enable_pin: The pin that EN is wired to, with a resistor to ground; None: EN is high.
        felt: Called with (stamp_ns, output) at every change of the strongest output.
    """

    def __init__(
        self, link, channels=(0, 1), enable_pin=None, felt: Callable = lambda stamp_ns, output: None
    ):
        self.enable_pin, self.felt, self.loudest, self.deaf_until_s = enable_pin, felt, 0.0, 0.0
        self.outputs = []  # (stamp_ns, each driver's output) of every change
        self.lock = threading.RLock()
        self.has_i2c, self.bus_enabled, self.buffer = True, False, bytearray(32)
        self.drivers = {channel: Drv2605l(self.note_outputs) for channel in channels or (None,)}
        self.multiplexer = Tca9548a() if channels else None
        super().__init__(link)
        self.set_enabled()

    @property
    def now(self):
        return tuple(driver.output for driver in self.drivers.values())

    def note_outputs(self):
        if not hasattr(self, "drivers"):
            return
        with self.changed:
            if not self.outputs or self.now != self.outputs[-1][1]:
                self.outputs.append((time.monotonic_ns(), self.now))
                if max(self.now) != self.loudest:
                    self.loudest, self.commands_at_edge = max(self.now), self.commands
                    self.felt(self.outputs[-1][0], self.loudest)
                self.changed.notify_all()

    def plug(self):
        super().plug()
        self.bus_enabled = False
        for driver in self.drivers.values():
            driver.power_up()

    def unplug(self):
        super().unplug()
        for driver in self.drivers.values():
            driver.lose_power()
        self.set_enabled()

    def reset(self):
        """Restart the board; the chips have power meanwhile, and go on unless EN falls."""
        super().reset()
        self.bus_enabled = False
        self.set_enabled()

    def restart(self, boot_s):
        """Restart the board; it does not hear anything until it has booted."""
        self.deaf_until_s = time.monotonic() + boot_s
        self.reset()

    def set_enabled(self):
        level = self.enable_pin is None or (
            self.modes.get(self.enable_pin) == 1 and self.values.get(self.enable_pin)
        )
        for driver in self.drivers.values():
            driver.enabled = bool(level)
        self.note_outputs()

    def vibrates(self, pin=None):
        return max(self.now) > 0

    def is_recovered(self):
        """Return whether it vibrates and got two further rounds of commands: the host accepted the first answers."""
        return self.vibrates() and self.commands >= self.commands_at_edge + 10 * len(self.drivers)

    def handle(self, master, command, data):
        if time.monotonic() < self.deaf_until_s:
            return
        super().handle(master, command, data)
        if command & 0xF0 == 0x90:  # levels of eight pins
            for bit, pin in enumerate(range(8 * (command & 0x0F), 8 * (command & 0x0F) + 8)):
                if self.modes.get(pin) == 1:
                    self.values[pin] = (data[0] | data[1] << 7) >> bit & 1
        if command == 0xF4 or command & 0xF0 == 0x90:
            self.set_enabled()

    def modes_of(self, pin):
        return super().modes_of(pin) + (bytes((6, 1)) if pin in (18, 19) and self.has_i2c else b"")

    def handle_sysex(self, master, command, data):
        if command == 0x78:
            self.bus_enabled = True
        elif command == 0x76:
            address, mode = data[0], data[1] >> 3 & 3
            content = bytes(low | high << 7 for low, high in zip(data[2::2], data[3::2], strict=True))
            with self.changed:
                self.commands += 1
                self.changed.notify_all()
            if mode == 0:
                for chip in self.chips_at(address):
                    chip.write(content)
            elif mode == 1:
                self.read_chip(master, address, content)
        else:
            super().handle_sysex(master, command, data)

    def chips_at(self, address):
        """Return what acknowledges an address: several drivers if several channels are connected."""
        if not self.bus_enabled:
            return []
        if self.multiplexer and address == 0x70:
            return [self.multiplexer]
        if address != 0x5A:
            return []
        mask = self.multiplexer.mask if self.multiplexer else 0
        connected = [
            driver for channel, driver in self.drivers.items() if channel is None or mask >> channel & 1
        ]
        return [driver for driver in connected if driver.is_listening()]

    def read_chip(self, master, address, content):
        register, count = content if len(content) == 2 else (None, content[0])
        chips = self.chips_at(address)
        self.buffer[:2] = address, register or 0
        if not chips:
            self.send_sysex(master, 0x71, halves(b"I2C: Too few bytes received"))
        for chip in chips:
            if register is not None:
                chip.write(bytes((register,)))
            self.buffer[2 : 2 + count] = chip.read(count)
        self.send_sysex(master, 0x77, halves(self.buffer[: count + 2]))


def halves(data):
    return bytes(part for byte in data for part in (byte & 0x7F, byte >> 7))
