"""The haptic devices that vibrate, by name: the class of each, imported when chosen.

`haptigraph.stages.Device` is their contract.
"""

from typing import Any

from haptigraph.importing import chosen, is_own, load, load_own, split_own
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
    """Open a haptic device by NAME or NAME:ARGUMENT, or one of the user's own by MODULE:CLASS[:ARGUMENT].

    A device of the user's own may keep vibrating if the run dies, so it has a watchdog process too.

    Raises:
        BadInput: If there is no such device.
    """
    kind, _, argument = name.partition(":")
    if kind not in DEVICES and is_own(name):
        path, argument = split_own(name)
        load_own("device", path, DEVICES)
        return _watched(path, argument, path.partition(":")[0])
    if kind in WATCHED:
        return _watched(DEVICES[kind], argument, WATCHED[kind])
    return device_class(kind)(argument)  # type: ignore[no-any-return]


def _watched(path: str, argument: str, library: str) -> Device:
    watched = load("haptigraph.haptics.watchdog:WatchedDevice")
    return watched(path, argument, library)  # type: ignore[no-any-return]
