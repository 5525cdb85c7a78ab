"""Listen in on what a device is told, after the guard: what is shown is what is felt."""

from collections.abc import Callable
from typing import TypeAlias

from haptigraph.messages import Capabilities
from haptigraph.stages import Device

__all__ = ["PAGE_CONTROLLER", "Listener", "ObservedDevice"]

Listener: TypeAlias = Callable[[int, float, float], None]
"""Told (stamp_ns, amplitude, frequency_hz) of every change; must return at once and never raise."""

PAGE_CONTROLLER = Capabilities(
    amplitude_levels=65535,
    frequency_range_hz=None,
    shortest_on_ms=50.0,
    max_rate_hz=20.0,
    holds_ms=150.0,
    limitations="Below 120 Hz only the strong motor turns, else both. Changes are queued, silence never.",
)
"""What a game controller does that listens through the live page; `static/live/rumble.js` plays it."""


class ObservedDevice:
    """Pass everything on to a device, and tell a listener.

    The listener hears a change even if the device fails: it may be the only one that the hand feels.

    Args:
        device: The device.
        listener: Who hears.
    """

    def __init__(self, device: Device, listener: Listener) -> None:
        self.capabilities = device.capabilities
        self._device, self._listener = device, listener

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Tell listener and device."""
        self._listener(stamp_ns, amplitude, frequency_hz)
        self._device.set(amplitude, frequency_hz, stamp_ns)

    def close(self) -> None:
        """Close the device."""
        self._device.close()
