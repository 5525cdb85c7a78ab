"""A game controller of this machine as a leader, through SDL2, which knows the layout of most of them.

The sticks are those of `sticks`. The left trigger opens the jaws of forceps, the right one closes them.
"""

from collections.abc import Sequence

from haptigraph.clock import Clock
from haptigraph.errors import BadInput, DeviceError
from haptigraph.sdl import check_connected, controller_number, controllers, load_sdl, sdl_error
from haptigraph.teleop.leaders.sticks import StickTimer, stick_motion
from haptigraph.teleop.motion import HandMotion

__all__ = ["GamepadLeader"]

FEATURE = "leader gamepad"
FULL_SCALE = 32767
AXES = ("LEFTX", "LEFTY", "RIGHTY", "TRIGGERLEFT", "TRIGGERRIGHT")


class GamepadLeader:
    """Read one controller.

    Args:
        argument: Number of the controller, from 0; the first if empty.
        clock: Measures how long a stick is held.

    Raises:
        BadInput: If it is not connected, or SDL does not know its layout.
        MissingExtra: If PySDL2 is not installed.
    """

    def __init__(self, argument: str, clock: Clock) -> None:
        self._number, self._sdl, self._pad = controller_number(argument), load_sdl(FEATURE), None
        self._clock, self._timer = clock, StickTimer(clock.now_ns())
        try:
            self._open()
        except DeviceError as error:
            raise BadInput(str(error), f"gamepad:{self._number}") from None

    @staticmethod
    def found() -> dict[str, str]:
        """Return the connected controllers: the argument and the name of each."""
        return controllers(FEATURE)

    def take(self) -> Sequence[HandMotion]:
        """Return the motion since the last call."""
        self._sdl.SDL_GameControllerUpdate()
        elapsed_s = self._timer.elapsed_s(self._clock.now_ns())
        if self._pad is None:
            self._open()
        elif not self._sdl.SDL_GameControllerGetAttached(self._pad):
            self.close()
            raise DeviceError(f"controller {self._number} was unplugged")
        if not self._sdl.SDL_GameControllerGetButton(
            self._pad, self._sdl.SDL_CONTROLLER_BUTTON_RIGHTSHOULDER
        ):
            return (HandMotion(engaged=False),)
        right, back, towards, opens, closes = (self._axis(name) for name in AXES)
        return (stick_motion(elapsed_s, back=back, right=right, towards=towards, apart=opens - closes),)

    def close(self) -> None:
        """Release the controller."""
        pad, self._pad = self._pad, None
        if pad:
            self._sdl.SDL_GameControllerClose(pad)

    def _axis(self, name: str) -> float:
        """Return a deflection, -1 to 1; back and right are positive."""
        axis = getattr(self._sdl, f"SDL_CONTROLLER_AXIS_{name}")
        deflection: float = self._sdl.SDL_GameControllerGetAxis(self._pad, axis) / FULL_SCALE
        return max(deflection, -1.0)

    def _open(self) -> None:
        check_connected(self._sdl, self._number)
        if not self._sdl.SDL_IsGameController(self._number):
            raise DeviceError(
                f"SDL does not know the layout of controller {self._number}; describe it in the environment "
                "variable SDL_GAMECONTROLLERCONFIG, or use joy"
            )
        self._pad = self._sdl.SDL_GameControllerOpen(self._number)
        if not self._pad:
            raise DeviceError(f"controller {self._number} cannot be opened ({sdl_error(self._sdl)})")
