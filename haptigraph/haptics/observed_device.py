"""Observe the output of a device downstream of the guard, so that the page shows what the actuator does."""

from collections.abc import Callable
from typing import TypeAlias

from haptigraph.messages import Capabilities
from haptigraph.stages import Device

__all__ = ["PAGE_CONTROLLER", "Listener", "ObservedDevice"]

Listener: TypeAlias = Callable[[int, float, float], None]
"""Called with (stamp_ns, amplitude, frequency_hz) at every change; must return at once and never raise."""

PAGE_CONTROLLER = Capabilities(
    amplitude_levels=65535,
    frequency_range_hz=None,
    shortest_on_ms=50.0,
    max_rate_hz=20.0,
    holds_ms=150.0,
    limitations="Below 120 Hz only the strong motor turns, else both. Changes are queued, silence never.",
)
"""A game controller that the live page drives; `static/live/rumble.js` plays it."""


class ObservedDevice:
    """Forward everything to a device and notify a listener.

    The listener is notified even if the device fails, because it may drive the only working actuator.

    Args:
        device: The device.
        listener: The observer.
    """

    def __init__(self, device: Device, listener: Listener) -> None:
        self.capabilities = device.capabilities
        self._device, self._listener = device, listener

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Notify the listener and set the device."""
        self._listener(stamp_ns, amplitude, frequency_hz)
        self._device.set(amplitude, frequency_hz, stamp_ns)

    def close(self) -> None:
        """Close the device."""
        self._device.close()
