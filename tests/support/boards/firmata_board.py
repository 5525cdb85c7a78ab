"""A simulated board with Firmata on a pseudo-terminal: it decodes the commands for a motor.

Written for tests from the protocol document alone (github.com/firmata/protocol 2.5), it shares no code with the
device under test. It logs the arrival time of every change of a pin.
"""

import os
import pty
import select
import threading
import time
import tty
from pathlib import Path

ANALOG_IO, DIGITAL_IO, SYSEX, PIN_MODE, SYSEX_END, PROTOCOL_VERSION, RESET = (
    0xE0,
    0x90,
    0xF0,
    0xF4,
    0xF7,
    0xF9,
    0xFF,
)
LENGTHS = {0xE0: 2, 0x90: 2, 0xC0: 1, 0xD0: 1, PIN_MODE: 2, 0xF5: 2, PROTOCOL_VERSION: 0, RESET: 0}


class Decoder:
    """Split the bytes from a host into messages: (command byte, data bytes)."""

    def __init__(self):
        self.command, self.data, self.garbage = None, bytearray(), 0

    def feed(self, byte):
        if self.command == SYSEX:
            if byte == SYSEX_END:
                message, self.command = (SYSEX, bytes(self.data)), None
                return message
            assert byte < 0x80, f"byte {byte:#x} inside a system message"
            self.data.append(byte)
            return None
        if byte >= 0x80:
            self.command, self.data = byte, bytearray()
        elif self.command is None:
            self.garbage += 1
            return None
        else:
            self.data.append(byte)
        if self.command == SYSEX:
            return None
        kind = self.command if self.command >= 0xF0 else self.command & 0xF0
        if len(self.data) == LENGTHS[kind]:
            message, self.command = (self.command, bytes(self.data)), None
            return message
        return None


class Board:
    """An Uno with StandardFirmata; `pins` maps the number of each PWM pin to its resolution in bits."""

    def __init__(self, link: Path, pins=None, on_change=lambda stamp_ns, pin, value: None):
        self.link, self.on_change = link, on_change
        self.pins = pins or {3: 8, 5: 8, 6: 8, 9: 8, 10: 8, 11: 8, 20: 8}
        self.edges: list[tuple[int, int, int]] = []  # stamp_ns, pin, value
        self.changed = threading.Condition()
        self.commands = self.commands_at_edge = 0
        self.responds = True  # False: reads, but sends nothing
        self.corrupts = False  # True: its responses have no content
        self.master = self.slave = -1
        self.wake_read, self.wake_write = os.pipe()
        self.plug()

    def plug(self):
        """Connect, with pins as after power-on."""
        self.modes, self.values, self.decoder = {}, {}, Decoder()
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(os.ttyname(self.slave))
        self.thread = threading.Thread(target=self.serve, args=(self.master,), daemon=True)
        self.thread.start()

    def unplug(self):
        """Disconnect, as when the cable is pulled: no power, no vibration."""
        os.write(self.wake_write, b"x")
        self.thread.join(10)
        self.link.unlink()
        os.close(self.master)
        os.close(self.slave)
        for pin in [pin for pin, value in self.values.items() if value]:
            self.note(pin, 0)

    def reset(self):
        """Restart while connected: brown-out, or the button."""
        for pin in [pin for pin, value in self.values.items() if value]:
            self.note(pin, 0)
        self.modes, self.values, self.decoder = {}, {}, Decoder()

    def close(self):
        if self.link.is_symlink():
            self.unplug()
        os.close(self.wake_read)
        os.close(self.wake_write)

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.close()

    def serve(self, master):
        while True:
            ready, _, _ = select.select([master, self.wake_read], [], [])
            if self.wake_read in ready:
                os.read(self.wake_read, 1)
                return
            for byte in os.read(master, 4096):
                message = self.decoder.feed(byte)
                if message is not None:
                    self.handle(master, *message)

    def handle(self, master, command, data):
        if command == PROTOCOL_VERSION:
            self.send(master, bytes((PROTOCOL_VERSION, 2, 5)))
        elif command == PIN_MODE:
            self.modes[data[0]] = data[1]
        elif command & 0xF0 == ANALOG_IO:
            self.write(command & 0x0F, data[0] | data[1] << 7)
        elif command == SYSEX:
            self.handle_sysex(master, data[0], data[1:])

    def handle_sysex(self, master, command, data):
        if command == 0x79:  # firmware: version, then the name with two bytes per character
            name = b"".join(bytes((ord(letter) & 0x7F, ord(letter) >> 7)) for letter in "StandardFirmata.ino")
            self.send_sysex(master, 0x79, bytes((2, 5)) + name)
        elif command == 0x6B:  # capabilities: mode and bits of each, 127 after every pin
            self.send_sysex(master, 0x6C, b"".join(self.modes_of(pin) + b"\x7f" for pin in range(21)))
        elif command == 0x6D:  # state of a pin
            value = self.values.get(data[0], 0)
            state = bytes(value >> shift & 0x7F for shift in range(0, max(value.bit_length(), 1), 7))
            self.send_sysex(master, 0x6E, bytes((data[0], self.modes.get(data[0], 1))) + state)
        elif command == 0x6F:  # extended analog
            self.write(data[0], sum(bits << 7 * index for index, bits in enumerate(data[1:])))

    def modes_of(self, pin):
        return bytes((0, 1, 1, 1)) + (bytes((3, self.pins[pin])) if pin in self.pins else b"")

    def write(self, pin, value):
        with self.changed:
            self.commands += 1
            self.changed.notify_all()
        if self.modes.get(pin) == 3 and self.values.get(pin) != value:
            self.note(pin, value)

    def note(self, pin, value):
        with self.changed:
            self.values[pin], self.commands_at_edge = value, self.commands
            self.edges.append((time.monotonic_ns(), pin, value))
            self.on_change(*self.edges[-1])
            self.changed.notify_all()

    def send_sysex(self, master, command, data):
        content = b"" if self.corrupts else data
        self.send(master, bytes((SYSEX, command)) + content + bytes((SYSEX_END,)))

    def send(self, master, message):
        if self.responds:
            os.write(master, message)

    def until(self, condition, timeout_s=20.0):
        """Wait until `condition(self)` holds after a change; return when the change arrived [ns]."""
        with self.changed:
            assert self.changed.wait_for(lambda: condition(self), timeout_s), self.edges[-5:]
            return self.edges[-1][0] if self.edges else time.monotonic_ns()

    def vibrates(self, pin=9):
        return self.values.get(pin, 0) > 0

    def is_recovered(self):
        """Return whether it vibrates and received further commands, so the host accepted its responses."""
        return self.vibrates() and self.commands >= self.commands_at_edge + 3
