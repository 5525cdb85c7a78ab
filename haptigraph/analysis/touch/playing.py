"""Play a vibration on a device, through the guard."""

from haptigraph.analysis.actuators import DeviceTest, advance_until, guarded_step, play_pattern
from haptigraph.analysis.touch.loading import Touch
from haptigraph.clock import Clock
from haptigraph.config import HapticsConfig
from haptigraph.haptics.formats.curve import value_after
from haptigraph.haptics.formats.envelope import Envelope, plain
from haptigraph.haptics.guard import Guard
from haptigraph.haptics.pattern import NS_PER_MS
from haptigraph.messages import OFF, Pattern
from haptigraph.stages import Device

__all__ = ["play_touch"]

STEP_MS = 10.0


def play_touch(device: Device, touch: Touch, clock: Clock, config: HapticsConfig) -> DeviceTest:
    """Play a vibration once; the device is silent and closed on every exit.

    A pattern is played as in a run; without one, amplitude and frequency are set every 10 ms and at each
    point.

    Args:
        device: The device; closed afterwards.
        touch: What to play, for as long as its envelope lasts.
        clock: Paces the playback.
        config: The limits.
    """
    test = DeviceTest(device)
    guard = Guard(test, config)
    try:
        if touch.pattern is not None:
            play_pattern(guard, touch.pattern, round(touch.envelope.duration_ms * NS_PER_MS), clock)
        else:
            _play_envelope(guard, plain(touch.envelope), clock)
    finally:
        test.end(guard)
    return test


def _play_envelope(guard: Guard, envelope: Envelope, clock: Clock) -> None:
    steps = {STEP_MS * number for number in range(int(envelope.duration_ms / STEP_MS) + 1)}
    points = {time_ms for curve in (envelope.amplitude, envelope.frequency_hz) for time_ms, _ in curve}
    since_ns = clock.now_ns()
    for time_ms in sorted(time_ms for time_ms in steps | points if time_ms < envelope.duration_ms):
        advance_until(guard, since_ns + round(time_ms * NS_PER_MS), clock)
        now_ns = clock.now_ns()
        amplitude = value_after(envelope.amplitude, time_ms)
        frequency_hz = value_after(envelope.frequency_hz, time_ms)
        pattern = Pattern("touch", "continuous", amplitude, frequency_hz) if amplitude else OFF
        guard.send(guarded_step(pattern, now_ns, now_ns), now_ns)
    advance_until(guard, since_ns + round(envelope.duration_ms * NS_PER_MS), clock)
