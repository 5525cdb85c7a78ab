"""Observe a device downstream of the guard: pages show its output, recordings have what it confirms.

A board confirms the value of its pin, a DRV2605L that of its register; a controller's driver or browser
confirms that it took the command. The other outputs confirm nothing.
"""

from collections import deque
from collections.abc import Callable
from typing import TypeAlias

from haptigraph.importing import is_own
from haptigraph.messages import Capabilities, Delivered
from haptigraph.stages import Device

__all__ = [
    "PAGE_CONTROLLER", "ConfirmedDevice", "DeliveryLog", "Listener", "ObservedDevice", "confirmed",
    "confirms", "is_felt",
]  # fmt: skip

ACTUATORS = ("audio", "crtk", "drv2605", "gamepad", "ros2", "serial")
NOT_FELT = ("console", "trace")
CONFIRMING = ("controller", "drv2605", "gamepad", "serial")
MAX_PERIODS = 10_000

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


def is_felt(device: str) -> bool:
    """Return whether a person feels a device of this name: an actuator, not a file or the terminal.

    One of the user's own counts as felt.
    """
    kind = device.partition(":")[0]
    return (kind in ACTUATORS and not device.endswith(".wav")) or (kind not in NOT_FELT and is_own(device))


def confirms(output: str) -> bool:
    """Return whether an output, or one of several joined by " + ", confirms that it vibrates."""
    return any(each.partition(":")[0] in CONFIRMING for each in output.split(" + "))


class DeliveryLog:
    """Confirmed periods since the last call of `take`; any thread may add one."""

    def __init__(self) -> None:
        self._periods: deque[Delivered] = deque(maxlen=MAX_PERIODS)

    def add(self, period: Delivered) -> None:
        """Add a period; one that has no length is ignored."""
        if period.end_ns > period.start_ns:
            self._periods.append(period)

    def take(self) -> tuple[Delivered, ...]:
        """Return the periods since the last call."""
        return tuple(self._periods.popleft() for _ in range(len(self._periods)))


class ConfirmedDevice:
    """Forward everything to a device that confirms, and log its periods of vibration.

    A period ends with the next command, whether it succeeds or not, or when the device falls silent by
    itself. One that lasts until the device is closed is logged too late for the run.

    Args:
        device: The device.
        name: Its name in the log.
        log: The log.
    """

    def __init__(self, device: Device, name: str, log: DeliveryLog) -> None:
        self.capabilities = device.capabilities
        self._device, self._name, self._log = device, name, log
        self._since_ns: int | None = None
        holds_ms = device.capabilities.holds_ms
        self._holds_ns = None if holds_ms is None else round(holds_ms * 1e6)

    def set(self, amplitude: float, frequency_hz: float, stamp_ns: int) -> None:
        """Set the device."""
        if self._since_ns is not None:
            silent_ns = stamp_ns if self._holds_ns is None else self._since_ns + self._holds_ns
            self._log.add(Delivered(self._since_ns, min(stamp_ns, silent_ns), self._name))
            self._since_ns = None
        self._device.set(amplitude, frequency_hz, stamp_ns)
        if amplitude:
            self._since_ns = stamp_ns

    def close(self) -> None:
        """Close the device."""
        self._device.close()


def confirmed(device: Device, name: str, log: DeliveryLog) -> Device:
    """Return a device, logged if one of its name confirms."""
    return ConfirmedDevice(device, name, log) if confirms(name) else device
