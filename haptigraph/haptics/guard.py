"""The last instance before the hand: limits, dead-man timer, silence. Nothing bypasses it.

Turns commands into the amplitudes a device is told, edge by edge. It is told the time, and starts no thread;
`player` drives it in real time. Knows nothing of states but that `unknown` is felt as silence.
"""

import math

from msgspec.structs import replace

from haptigraph.config import HapticsConfig
from haptigraph.haptics.pattern import NS_PER_MS, amplitude_at, fitted, least_gap_ms, next_change_ns
from haptigraph.messages import OFF, UNKNOWN, Fault, HapticCommand, Pattern, Step
from haptigraph.stages import Device

__all__ = ["Guard"]

RETRY_NS = 1_000_000_000  # a failed device is tried again once a second,
SILENCE_RETRY_NS = 50_000_000  # and much sooner when it was to fall silent


class Guard:
    """Stand between the loop and one device.

    The hand is still when no command came yet, when none came for `deadman_ms`, when the state is unknown,
    while it rests after `max_on_ms` of vibration, and after `close`. A device that fails is reported once
    and tried again; it never raises out of here.

    Patterns are fitted to what the device can do; changes wait until it takes them, silence never waits. A
    device that falls silent by itself is told again in time.

    Args:
        device: The actuator; only the guard calls it.
        config: The limits.
    """

    def __init__(self, device: Device, config: HapticsConfig) -> None:
        self._device, self._can = device, device.capabilities
        self._gap_ns = round(least_gap_ms(self._can) * NS_PER_MS)
        half_ns = round((self._can.holds_ms or 0.0) * NS_PER_MS / 2)
        self._renew_ns = max(half_ns, self._gap_ns) if half_ns else None
        self._max_amplitude = config.max_amplitude
        self._deadman_ns = round(config.deadman_ms * NS_PER_MS)
        self._max_on_ns = round(config.max_on_ms * NS_PER_MS)
        self._rest_ns = round(config.rest_ms * NS_PER_MS)
        self._command = HapticCommand(0, OFF, 0)
        self._received_ns: int | None = None
        self._lag_ns = 0
        self._at_ns = 0
        self._told: tuple[float, float] | None = None
        self._told_at_ns: int | None = None
        self._on_since_ns: int | None = None
        self._rest_until_ns: int | None = None
        self._retry_at_ns: int | None = None
        self._failed_on = False
        self._faults: list[Fault] = []
        self._closed = False

    def send(self, step: Step, now_ns: int) -> None:
        """Take the newest step; what it commands is felt from now on.

        Args:
            step: The step; silence if its state is unknown, whatever it commands.
            now_ns: The present.
        """
        self.advance(now_ns)
        command = step.command
        if not _is_sound(command.pattern):
            problem = (
                f"pattern {command.pattern.name!r} has a number below 0 or not finite; the hand is still"
            )
            self._faults.append(Fault("guard", problem))
            command = HapticCommand(command.stamp_ns, OFF, command.stamp_ns)
        if step.conclusion.state == UNKNOWN:
            command = HapticCommand(command.stamp_ns, OFF, command.stamp_ns)
        command = replace(command, pattern=fitted(command.pattern, self._can))
        if command.pattern.name != self._command.pattern.name or command.since_ns == command.stamp_ns:
            # A pattern starts when it arrives: the way here must not eat the beginning of a short burst.
            self._lag_ns = now_ns - command.since_ns
        self._command, self._received_ns = command, now_ns
        self._apply(now_ns)

    def advance(self, now_ns: int) -> None:
        """Tell the device everything that was due up to now."""
        while (edge_ns := self.next_edge_ns()) is not None and edge_ns <= now_ns:
            self._apply(edge_ns)
        self._apply(max(now_ns, self._at_ns))

    def next_edge_ns(self) -> int | None:
        """Return when something will next change if no command comes; None if nothing will."""
        edges = [self._retry_at_ns, self._rest_until_ns]
        if self._told_at_ns is not None and self._retry_at_ns is None:
            edges.append(self._told_at_ns + self._gap_ns)
            edges.append(self._renewal_ns())
        if self._received_ns is not None and self._at_ns < self._received_ns + self._deadman_ns:
            edges.append(self._received_ns + self._deadman_ns)
            change_ns = next_change_ns(self._command, self._at_ns - self._lag_ns)
            edges.append(None if change_ns is None else change_ns + self._lag_ns)
        if self._on_since_ns is not None:
            edges.append(self._on_since_ns + self._max_on_ns)
        return min((edge for edge in edges if edge is not None and edge > self._at_ns), default=None)

    def take_faults(self) -> tuple[Fault, ...]:
        """Return what went wrong since last asked."""
        faults, self._faults = tuple(self._faults), []
        return faults

    def silence(self) -> None:
        """Silence, until another step is sent."""
        self._received_ns, self._command = None, HapticCommand(0, OFF, 0)
        self._on_since_ns = None
        self._tell(0.0, 0.0, self._at_ns)

    def close(self) -> None:
        """Still the hand for good and release the device."""
        if self._closed:
            return
        self._closed = True
        self.silence()
        try:
            self._device.close()
        except Exception as error:
            self._report(f"did not close: {error}")

    def _apply(self, now_ns: int) -> None:
        """Bring the device to what is due at one moment."""
        self._at_ns = now_ns
        amplitude = self._due(now_ns)
        if amplitude == 0:
            self._on_since_ns = None
        elif self._on_since_ns is None:
            self._on_since_ns = now_ns
        elif now_ns - self._on_since_ns >= self._max_on_ns:
            self._on_since_ns = None
            self._rest_until_ns = now_ns + self._rest_ns
            self._faults.append(Fault("guard", f"hand rests: it vibrated for {self._max_on_ns / 1e9:g} s"))
            amplitude = 0.0
        frequency_hz = self._command.pattern.frequency_hz if amplitude else 0.0
        if self._is_news(amplitude, frequency_hz, now_ns):
            self._tell(amplitude, frequency_hz, now_ns)

    def _is_news(self, amplitude: float, frequency_hz: float, now_ns: int) -> bool:
        """Tell whether the device must be told: it does not know, or failed and is tried again."""
        if self._retry_at_ns is None:
            if self._told != (amplitude, frequency_hz):
                return not amplitude or self._told_at_ns is None or now_ns >= self._told_at_ns + self._gap_ns
            renewal_ns = self._renewal_ns()
            return renewal_ns is not None and now_ns >= renewal_ns
        return now_ns >= self._retry_at_ns or (self._failed_on and not amplitude)

    def _renewal_ns(self) -> int | None:
        """Return when a device that vibrates must be told again so that it goes on; None if never."""
        if self._renew_ns is None or self._told_at_ns is None or not (self._told and self._told[0]):
            return None
        return self._told_at_ns + self._renew_ns

    def _due(self, now_ns: int) -> float:
        """Return the amplitude the command and the limits allow at one moment, but for the on-time."""
        if self._received_ns is None or now_ns - self._received_ns >= self._deadman_ns:
            return 0.0
        if self._rest_until_ns is not None:
            if now_ns < self._rest_until_ns:
                return 0.0
            self._rest_until_ns = None
        amplitude = min(amplitude_at(self._command, now_ns - self._lag_ns), self._max_amplitude)
        return amplitude if 0 <= amplitude <= self._max_amplitude else 0.0  # nan is neither

    def _tell(self, amplitude: float, frequency_hz: float, now_ns: int) -> None:
        self._told_at_ns = now_ns
        try:
            self._device.set(amplitude, frequency_hz, now_ns)
        except Exception as error:  # a device may be anyone's
            if self._retry_at_ns is None:
                self._report(str(error) or type(error).__name__)
            self._told, self._failed_on = None, amplitude > 0
            self._retry_at_ns = now_ns + (RETRY_NS if amplitude else SILENCE_RETRY_NS)
        else:
            self._told, self._retry_at_ns = (amplitude, frequency_hz), None

    def _report(self, message: str) -> None:
        self._faults.append(Fault("device", message))


def _is_sound(pattern: Pattern) -> bool:
    """Tell whether every number of a pattern is one that a limit can hold: finite and not negative."""
    numbers = pattern.amplitude, pattern.frequency_hz, pattern.on_ms, pattern.off_ms
    return all(math.isfinite(number * NS_PER_MS) and number >= 0 for number in numbers)
