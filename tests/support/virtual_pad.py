"""A game controller that SDL simulates: its rumble callback receives the commands for the motors."""

import ctypes
import os
import time

from haptigraph.haptics.gamepad import GamepadDevice
from haptigraph.sdl import load_sdl


class VirtualPad:
    """Attach a controller; `rumbles` contains (stamp_ns, slow, fast) of every call of the driver."""

    def __init__(self, *, can_rumble=True, on_rumble=None):
        self.sdl = load_sdl("test")
        self.rumbles = []
        self.fails = False
        self._opened = None
        self.on_rumble = on_rumble or (lambda *edge: None)
        kind = dict(self.sdl.SDL_VirtualJoystickDesc._fields_)["Rumble"]
        self.callback = kind(self.rumble)
        self.description = self.sdl.SDL_VirtualJoystickDesc(version=1, type=1, naxes=6, nbuttons=15)
        self.description.name = b"Virtual Pad"
        if can_rumble:
            self.description.Rumble = self.callback
        self.number = self.sdl.SDL_JoystickAttachVirtualEx(ctypes.byref(self.description))
        assert self.number >= 0, self.sdl.SDL_GetError()

    def rumble(self, userdata, slow, fast):
        if self.fails:
            return -1
        edge = (time.monotonic_ns(), slow, fast)
        self.rumbles.append(edge)
        self.on_rumble(*edge)
        return 0

    def motors(self):
        return self.rumbles[-1][1:] if self.rumbles else (0, 0)

    def tilt(self, axis, deflection):
        """Move a stick or trigger: -1 to 1."""
        self.sdl.SDL_JoystickSetVirtualAxis(self._joystick(), axis, round(deflection * 32767))

    def press(self, button, is_pressed=True):
        self.sdl.SDL_JoystickSetVirtualButton(self._joystick(), button, int(is_pressed))

    def _joystick(self):
        self._opened = self._opened or self.sdl.SDL_JoystickOpen(self.number)
        return self._opened

    def detach(self):
        if self._opened:
            self.sdl.SDL_JoystickClose(self._opened)
        self.sdl.SDL_JoystickDetachVirtual(self.number)
        self.sdl.SDL_JoystickUpdate()


class VirtualGamepad(GamepadDevice):
    """The gamepad device with its own simulated controller; opened by name, so it works in another process too.

    Every rumble is appended as a line to the file that the environment names; the imperceptible one with which
    the device opens counts as silence.
    """

    def __init__(self, argument=""):
        path = os.environ.get("HAPTIGRAPH_TEST_OUTPUT")
        file = open(path, "a", buffering=1) if path else None  # noqa: SIM115

        def write(stamp_ns, *levels):
            if file:
                print(stamp_ns, *(level if level > 1 else 0 for level in levels), file=file)

        self.pad = VirtualPad(on_rumble=write)
        super().__init__(argument)
