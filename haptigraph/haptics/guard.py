"""The last stage before the actuator: limits, dead-man timer, silence. Nothing bypasses it.

Turns commands into the amplitudes that a device is set to, edge by edge. The caller passes the time; `player`
drives the guard in real time from a thread of its own.
"""

import math

from msgspec.structs import replace

from haptigraph.config import HapticsConfig
from haptigraph.haptics.pattern import NS_PER_MS, amplitude_at, fit_to_device, min_interval_ms, next_change_ns
from haptigraph.haptics.profiles.profile import DeviceProfile
from haptigraph.messages import OFF, UNKNOWN, Fault, HapticCommand, Pattern, Step
from haptigraph.stages import Device

__all__ = ["Guard"]

RETRY_NS = 1_000_000_000  # a failed device is retried once a second,
SILENCE_RETRY_NS = 50_000_000  # and much sooner if the failed command was silence


class Guard:
    """Enforce all limits between the loop and one device.

    The actuator is silent before the first command, when no command arrives for `deadman_ms`, when the state
    is unknown, during the rest after `max_on_ms` of vibration, and after `close`. A device that fails is
    reported once and retried, and reported again when it responds; the guard does not raise its errors.

    Patterns are fitted to the capabilities of the device, and a profile turns their amplitude into the drive
    that is felt as such; the limits apply to the drive. Changes wait until the device accepts them; silence
    never waits. For a device that falls silent by itself, the guard renews the command in time.

    Args:
        device: The actuator; only the guard calls it.
        config: The limits.
        profile: How strong the device feels; None: amplitudes are its drive.
    """

    def __init__(self, device: Device, config: HapticsConfig, profile: DeviceProfile | None = None) -> None:
        self._device, self._profile = device, profile
        self._capabilities = profile.applied_to(device.capabilities) if profile else device.capabilities
        self._min_interval_ns = round(min_interval_ms(self._capabilities) * NS_PER_MS)
        half_ns = round((self._capabilities.holds_ms or 0.0) * NS_PER_MS / 2)
        self._renew_ns = max(half_ns, self._min_interval_ns) if half_ns else None
        self._max_amplitude = config.max_amplitude
        self._deadman_ns = round(config.deadman_ms * NS_PER_MS)
        self._max_on_ns = round(config.max_on_ms * NS_PER_MS)
        self._rest_ns = round(config.rest_ms * NS_PER_MS)
        self._command = HapticCommand(0, OFF, 0)
        self._received_ns: int | None = None
        self._lag_ns = 0
        self._now_ns = 0
        self._output: tuple[float, float] | None = None
        self._set_at_ns: int | None = None
        self._on_since_ns: int | None = None
        self._rest_until_ns: int | None = None
        self._retry_at_ns: int | None = None
        self._failed_while_on = False
        self._faults: list[Fault] = []
        self._closed = False
        self.is_silent = False
        """Whether the device was closed and raised no doubt that it is silent."""

    def send(self, step: Step, now_ns: int) -> None:
        """Take the newest step; its command is played from now on.

        Args:
            step: The step; silence if its state is unknown, whatever it commands.
            now_ns: The present.
        """
        self.advance(now_ns)
        command = step.command
        if not _is_valid(command.pattern):
            problem = f"pattern {command.pattern.name!r} has a number below 0 or not finite; output silenced"
            self._faults.append(Fault("guard", problem))
            command = HapticCommand(command.stamp_ns, OFF, command.stamp_ns)
        if step.conclusion.state == UNKNOWN:
            command = HapticCommand(command.stamp_ns, OFF, command.stamp_ns)
        command = replace(command, pattern=self._as_played(command.pattern))
        if command.pattern.name != self._command.pattern.name or command.since_ns == command.stamp_ns:
            # A pattern starts on arrival: latency must not shorten the beginning of a short burst.
            self._lag_ns = now_ns - command.since_ns
        self._command, self._received_ns = command, now_ns
        self._apply(now_ns)

    def advance(self, now_ns: int) -> None:
        """Apply every change that is due up to now."""
        while (edge_ns := self.next_edge_ns()) is not None and edge_ns <= now_ns:
            self._apply(edge_ns)
        self._apply(max(now_ns, self._now_ns))

    def next_edge_ns(self) -> int | None:
        """Return when the output next changes if no command arrives; None if it does not."""
        edges = [self._retry_at_ns, self._rest_until_ns]
        if self._set_at_ns is not None and self._retry_at_ns is None:
            edges += self._set_at_ns + self._min_interval_ns, self._renewal_ns()
        if self._received_ns is not None and self._now_ns < self._received_ns + self._deadman_ns:
            edges.append(self._received_ns + self._deadman_ns)
            change_ns = next_change_ns(self._command, self._now_ns - self._lag_ns)
            edges.append(None if change_ns is None else change_ns + self._lag_ns)
        if self._on_since_ns is not None:
            edges.append(self._on_since_ns + self._max_on_ns)
        return min([edge for edge in edges if edge is not None and edge > self._now_ns], default=None)

    def take_faults(self) -> tuple[Fault, ...]:
        """Return the faults since the previous call."""
        faults, self._faults = tuple(self._faults), []
        return faults

    def silence(self) -> None:
        """Silence the actuator until the next step."""
        self._received_ns, self._command = None, HapticCommand(0, OFF, 0)
        self._on_since_ns = None
        self._set_device(0.0, 0.0, self._now_ns)

    def close(self) -> None:
        """Silence the actuator for good and release the device."""
        if self._closed:
            return
        self._closed = True
        self.silence()
        self.is_silent = self._output == (0.0, 0.0)
        try:
            self._device.close()
        except Exception as error:
            self._report(f"did not close: {error}")
        else:
            self.is_silent = True

    def _as_played(self, pattern: Pattern) -> Pattern:
        """Return a pattern as the device is to play it: its amplitude is the drive."""
        fitted = fit_to_device(pattern, self._capabilities)
        if self._profile is None:
            return fitted
        return replace(fitted, amplitude=self._profile.drive_at(fitted.amplitude))

    def _apply(self, now_ns: int) -> None:
        """Bring the device to the output that is due at a time."""
        self._now_ns = now_ns
        amplitude = self._amplitude_due(now_ns)
        if amplitude == 0:
            self._on_since_ns = None
        elif self._on_since_ns is None:
            self._on_since_ns = now_ns
        elif now_ns - self._on_since_ns >= self._max_on_ns:
            self._on_since_ns = None
            self._rest_until_ns = now_ns + self._rest_ns
            problem = f"vibration paused for {self._rest_ns / 1e9:g} s: it lasted {self._max_on_ns / 1e9:g} s"
            self._faults.append(Fault("guard", problem))
            amplitude = 0.0
        frequency_hz = self._command.pattern.frequency_hz if amplitude else 0.0
        if self._is_set_due(amplitude, frequency_hz, now_ns):
            self._set_device(amplitude, frequency_hz, now_ns)

    def _is_set_due(self, amplitude: float, frequency_hz: float, now_ns: int) -> bool:
        """Return whether the device must be set: the output changed, needs renewal, or failed before."""
        if self._retry_at_ns is None:
            if self._output != (amplitude, frequency_hz):
                set_at_ns = self._set_at_ns
                return not amplitude or set_at_ns is None or now_ns >= set_at_ns + self._min_interval_ns
            renewal_ns = self._renewal_ns()
            return renewal_ns is not None and now_ns >= renewal_ns
        return now_ns >= self._retry_at_ns or (self._failed_while_on and not amplitude)

    def _renewal_ns(self) -> int | None:
        """Return when a vibrating device must be set again so that it continues; None if never."""
        if self._renew_ns is None or self._set_at_ns is None or not (self._output and self._output[0]):
            return None
        return self._set_at_ns + self._renew_ns

    def _amplitude_due(self, now_ns: int) -> float:
        """Return the amplitude that the command and the limits, except the on-time, allow at a time."""
        if self._received_ns is None or now_ns - self._received_ns >= self._deadman_ns:
            return 0.0
        if self._rest_until_ns is not None:
            if now_ns < self._rest_until_ns:
                return 0.0
            self._rest_until_ns = None
        amplitude = min(amplitude_at(self._command, now_ns - self._lag_ns), self._max_amplitude)
        return amplitude if 0 <= amplitude <= self._max_amplitude else 0.0  # nan is neither

    def _set_device(self, amplitude: float, frequency_hz: float, now_ns: int) -> None:
        self._set_at_ns = now_ns
        try:
            self._device.set(amplitude, frequency_hz, now_ns)
        except Exception as error:  # a device may be anyone's
            if self._retry_at_ns is None:
                self._report(str(error) or type(error).__name__)
            self._output, self._failed_while_on = None, amplitude > 0
            self._retry_at_ns = now_ns + (RETRY_NS if amplitude else SILENCE_RETRY_NS)
        else:
            if self._retry_at_ns is not None:
                self._faults.append(Fault("device", "responds again", is_over=True))
            self._output, self._retry_at_ns = (amplitude, frequency_hz), None

    def _report(self, message: str) -> None:
        self._faults.append(Fault("device", message))


def _is_valid(pattern: Pattern) -> bool:
    """Return whether every number of a pattern is finite and not negative, so that limits can apply."""
    numbers = pattern.amplitude, pattern.frequency_hz, pattern.on_ms, pattern.off_ms
    return all([math.isfinite(number * NS_PER_MS) and number >= 0 for number in numbers])
