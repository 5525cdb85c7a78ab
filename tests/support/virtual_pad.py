"""A game controller that SDL itself simulates: its rumble callback sees what the motors would."""

import ctypes
import os
import time

from haptigraph.haptics.gamepad import GamepadDevice, _sdl


class VirtualPad:
    """Attach a controller; `rumbles` holds (stamp_ns, slow, fast) of every call of the driver."""

    def __init__(self, *, can_rumble=True, heard=None):
        self.sdl = _sdl()
        self.rumbles = []
        self.fails = False
        self.heard = heard or (lambda *edge: None)
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
        self.heard(*edge)
        return 0

    def motors(self):
        return self.rumbles[-1][1:] if self.rumbles else (0, 0)

    def detach(self):
        self.sdl.SDL_JoystickDetachVirtual(self.number)
        self.sdl.SDL_JoystickUpdate()


class VirtualGamepad(GamepadDevice):
    """The gamepad device with a controller of its own; opened by name, so also in another process.

    What the motors feel is appended to the file that the environment names, a line each.
    """

    def __init__(self, argument=""):
        path = os.environ.get("HAPTIGRAPH_TEST_FELT")
        file = open(path, "a", buffering=1) if path else None  # noqa: SIM115
        self.pad = VirtualPad(heard=lambda *edge: file and print(*edge, file=file))
        super().__init__(argument)
