"""Let a game controller rumble, through SDL2.

SDL ends a rumble only while its events are pumped, and some controllers end one by themselves after seconds.
So a rumble is renewed while it lasts, for at most `HOLDS_MS` at a time, and silence is always sent.
`run_device` runs this device in a watchdog process, which silences it when the run dies.
"""

from haptigraph.errors import BadInput, DeviceError
from haptigraph.messages import Capabilities
from haptigraph.sdl import check_connected, controller_number, controllers, load_sdl, sdl_error

__all__ = ["GamepadDevice"]

HOLDS_MS = 150
HIGH_HZ = 120.0  # from here on the fast motor turns as well
FEATURE = "device gamepad"


class GamepadDevice:
    """Rumble one controller.

    Args:
        argument: Number of the controller, from 0; the first if empty.

    Raises:
        BadInput: If it is not connected or cannot rumble.
        MissingExtra: If PySDL2 is not installed.
    """

    capabilities = Capabilities(
        amplitude_levels=65535,
        frequency_range_hz=None,
        shortest_on_ms=50.0,
        max_rate_hz=20.0,
        holds_ms=HOLDS_MS,
        limitations="Below 120 Hz only the slow motor turns, else both. Changes are queued, silence never.",
    )

    def __init__(self, argument: str = "") -> None:
        self._number, self._sdl, self._pad = controller_number(argument), load_sdl(FEATURE), None
        self._closed = False
        try:
            self._open()
        except DeviceError as error:
            raise BadInput(str(error), f"gamepad:{self._number}") from None

    @staticmethod
    def found() -> dict[str, str]:
        """Return the connected controllers: the device argument and the name of each."""
        return controllers(FEATURE)

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Turn the motors."""
        self._sdl.SDL_JoystickUpdate()
        if self._pad is None or not self._sdl.SDL_JoystickGetAttached(self._pad):
            self._release()
            self._open()
        slow = round(amplitude * 65535)
        fast = slow if frequency_hz >= HIGH_HZ else 0
        if self._sdl.SDL_JoystickRumble(self._pad, slow, fast, HOLDS_MS if slow else 0):
            raise DeviceError(f"the controller does not rumble ({sdl_error(self._sdl)})")

    def close(self) -> None:
        """Stop the motors and release the controller.

        Raises:
            DeviceError: If it did not accept that.
        """
        if self._closed:
            return
        self._closed = True
        try:
            self.set(0.0, 0.0, 0)
        finally:
            self._release()

    def _open(self) -> None:
        check_connected(self._sdl, self._number)
        self._pad = self._sdl.SDL_JoystickOpen(self._number)
        if not self._pad or not self._sdl.SDL_JoystickHasRumble(self._pad):
            problem = "cannot rumble" if self._pad else f"cannot be opened ({sdl_error(self._sdl)})"
            self._release()
            raise DeviceError(f"controller {self._number} {problem}")
        # An earlier process may have left it vibrating; SDL sends no silence to what it takes for silent.
        for level in (1, 0):
            self._sdl.SDL_JoystickRumble(self._pad, level, 0, HOLDS_MS)

    def _release(self) -> None:
        pad, self._pad = self._pad, None
        if pad:
            self._sdl.SDL_JoystickClose(pad)
