"""SDL2, for game controllers alone: their motors and their sticks."""

import warnings
from typing import Any

from haptigraph.errors import BadInput, DeviceError, MissingExtra

__all__ = ["check_connected", "controller_number", "controllers", "load_sdl", "sdl_error"]

HINTS = {
    b"SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS": b"1",  # there is no window to receive the focus
    b"SDL_JOYSTICK_THREAD": b"1",
    b"SDL_NO_SIGNAL_HANDLERS": b"1",
}


def load_sdl(feature: str) -> Any:
    """Return SDL, initialised for controllers only.

    Args:
        feature: What needs it, for the errors.

    Raises:
        BadInput: If it does not start.
        MissingExtra: If PySDL2 is not installed.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it warns that it found its bundled library
            import sdl2  # noqa: PLC0415 - an extra
    except ImportError:  # also if its bundled library cannot be loaded
        raise MissingExtra(feature, "gamepad") from None
    for name, value in HINTS.items():
        sdl2.SDL_SetHint(name, value)
    if sdl2.SDL_InitSubSystem(sdl2.SDL_INIT_JOYSTICK | sdl2.SDL_INIT_GAMECONTROLLER):
        raise BadInput(f"SDL does not start ({sdl_error(sdl2)})", feature)
    return sdl2


def controllers(feature: str) -> dict[str, str]:
    """Return the connected controllers, gamepad:0, gamepad:1, ..., and the name of each."""
    sdl = load_sdl(feature)
    sdl.SDL_JoystickUpdate()
    names = [sdl.SDL_JoystickNameForIndex(number) for number in range(sdl.SDL_NumJoysticks())]
    return {
        f"gamepad:{number}": (name or b"unnamed").decode(errors="replace")
        for number, name in enumerate(names)
    }


def controller_number(argument: str) -> int:
    """Return the number after "gamepad:"; 0, the first controller, if there is none.

    Raises:
        BadInput: If it is not a number.
    """
    if argument and not argument.isdecimal():
        raise BadInput(f"gamepad:{argument} is not a controller; use gamepad:0 for the first one")
    return int(argument or 0)


def check_connected(sdl: Any, number: int) -> None:
    """Do nothing if a controller is connected.

    Raises:
        DeviceError: If it is not.
    """
    count = sdl.SDL_NumJoysticks()
    if number >= count:
        raise DeviceError(f"controller {number} is not connected; {count} are")


def sdl_error(sdl: Any) -> str:
    """Return SDL's description of its last error."""
    return str(sdl.SDL_GetError().decode(errors="replace"))
