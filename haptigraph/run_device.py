"""The haptic devices that vibrate, by name: the class of each, imported when chosen.

`haptigraph.stages.Device` is their contract.
"""

from typing import Any

from haptigraph.importing import chosen, load
from haptigraph.stages import Device

__all__ = ["DEVICES", "device_class", "open_device"]

DEVICES = {
    "audio": "haptigraph.haptics.audio:AudioDevice",
    "console": "haptigraph.haptics.console:ConsoleDevice",
    "crtk": "haptigraph.haptics.network.crtk:CrtkDevice",
    "drv2605": "haptigraph.haptics.boards.drv2605:Drv2605Device",
    "gamepad": "haptigraph.haptics.gamepad:GamepadDevice",
    "ros2": "haptigraph.haptics.network.ros2:Ros2Device",
    "serial": "haptigraph.haptics.boards.pwm:PwmDevice",
    "trace": "haptigraph.haptics.trace:TraceDevice",
}
# They would keep vibrating if the run died. With the module that each imports when it is opened.
WATCHED = {
    "crtk": "haptigraph.ros2.node",
    "drv2605": "serial",
    "gamepad": "sdl2",
    "ros2": "haptigraph.ros2.node",
    "serial": "serial",
}


def device_class(kind: str) -> Any:
    """Return the class of a device by its name.

    Raises:
        BadInput: If there is no such device.
    """
    return chosen(DEVICES, "device", kind)


def open_device(name: str) -> Device:
    """Open a haptic device by NAME or NAME:ARGUMENT.

    Raises:
        BadInput: If there is no such device.
    """
    kind, _, argument = name.partition(":")
    if kind in WATCHED:
        watched = load("haptigraph.haptics.watchdog:WatchedDevice")
        return watched(DEVICES[kind], argument, WATCHED[kind])  # type: ignore[no-any-return]
    return device_class(kind)(argument)  # type: ignore[no-any-return]
