"""Haptic patterns as amplitude over time, their fit to a device and to a person's threshold.

Pure functions.
"""

from collections.abc import Sequence

from msgspec.structs import replace

from haptigraph.messages import Capabilities, HapticCommand, Pattern

__all__ = [
    "NS_PER_MS",
    "amplitude_at",
    "amplitude_range",
    "duration_ns",
    "fit_to_device",
    "min_interval_ms",
    "next_change_ns",
    "position_ns",
    "unsupported",
    "vibrating_ns",
    "with_weakest",
]

NS_PER_MS = 1_000_000


def duration_ns(pattern: Pattern) -> int | None:
    """Return the duration of a pattern [ns]; None if it continues until it is replaced."""
    if pattern.kind != "bursts":
        return None
    return pattern.count * _on_ns(pattern) + (pattern.count - 1) * _off_ns(pattern)


def amplitude_at(command: HapticCommand, stamp_ns: int) -> float:
    """Return the amplitude of a command at a time, in [0, 1]."""
    pattern = command.pattern
    age_ns = stamp_ns - command.since_ns
    if pattern.kind == "off" or age_ns < 0:
        return 0.0
    if pattern.kind == "continuous":
        return pattern.amplitude
    end_ns = duration_ns(pattern)
    if end_ns is not None and age_ns >= end_ns:
        return 0.0
    return pattern.amplitude if age_ns % _period_ns(pattern) < _on_ns(pattern) else 0.0


def position_ns(before: Pattern, after: Pattern, age_ns: int) -> int:
    """Return where in its period a rhythm continues when its numbers change; 0, its start, if past the end.

    Args:
        before: The pattern so far.
        after: The same pattern with other numbers.
        age_ns: Time since its start.
    """
    period_ns = _period_ns(before)
    position = age_ns % period_ns if period_ns else 0
    return position if position < _period_ns(after) else 0


def next_change_ns(command: HapticCommand, stamp_ns: int) -> int | None:
    """Return the first time after `stamp_ns` at which the amplitude may change; None if it never does."""
    pattern = command.pattern
    if pattern.kind == "off":
        return None
    if stamp_ns < command.since_ns:
        return command.since_ns
    if pattern.kind == "continuous":
        return None
    age_ns = stamp_ns - command.since_ns
    end_ns = duration_ns(pattern)
    if end_ns is not None and age_ns >= end_ns:
        return None
    period_ns, on_ns = _period_ns(pattern), _on_ns(pattern)
    start_ns = stamp_ns - age_ns % period_ns
    return start_ns + on_ns if stamp_ns - start_ns < on_ns else start_ns + period_ns


def vibrating_ns(command: HapticCommand, from_ns: int, until_ns: int) -> int:
    """Return how long the amplitude is above 0 within a period."""
    total_ns, at_ns = 0, from_ns
    while at_ns < until_ns:
        change_ns = next_change_ns(command, at_ns)
        end_ns = until_ns if change_ns is None else min(change_ns, until_ns)
        total_ns += (end_ns - at_ns) * (amplitude_at(command, at_ns) > 0)
        at_ns = end_ns
    return total_ns


def min_interval_ms(capabilities: Capabilities) -> float:
    """Return the minimum interval between changes that a device accepts; 0 if there is none."""
    return 1000.0 / capabilities.max_rate_hz if capabilities.max_rate_hz else 0.0


def fit_to_device(pattern: Pattern, capabilities: Capabilities) -> Pattern:
    """Return a pattern as a device can play it: perceptible bursts, changes at intervals that it accepts.

    The onsets are kept as long as the pauses remain perceptible; otherwise the rhythm slows down.
    """
    if pattern.kind not in ("pulses", "bursts") or not pattern.on_ms:
        return pattern
    interval_ms = min_interval_ms(capabilities)
    on_ms = max(pattern.on_ms, capabilities.shortest_on_ms, interval_ms)
    left_ms = pattern.on_ms + pattern.off_ms - on_ms
    off_ms = max(left_ms, min(pattern.off_ms, capabilities.shortest_on_ms), interval_ms)
    return replace(pattern, on_ms=on_ms, off_ms=off_ms)


def unsupported(pattern: Pattern, capabilities: Capabilities) -> list[str]:
    """Return what a device cannot do of a pattern, one sentence each."""
    sentences = []
    if pattern.kind != "off" and capabilities.frequency_range_hz is None and pattern.frequency_hz:
        sentences.append(f"{pattern.name}: the device has its own frequency, not {pattern.frequency_hz:g} Hz")
    if capabilities.frequency_range_hz is not None and pattern.frequency_hz:
        low, high = capabilities.frequency_range_hz
        if not low <= pattern.frequency_hz <= high:
            sentences.append(f"{pattern.name}: {pattern.frequency_hz:g} Hz is outside {low:g} to {high:g} Hz")
    played = fit_to_device(pattern, capabilities)
    if (played.on_ms, played.off_ms) != (pattern.on_ms, pattern.off_ms):
        sentences.append(
            f"{pattern.name}: {pattern.on_ms:g} ms on, {pattern.off_ms:g} ms off become "
            f"{played.on_ms:g} on, {played.off_ms:g} off; no shorter ones are felt"
        )
    if capabilities.amplitude_levels == 1 and 0 < pattern.amplitude < 1:
        sentences.append(f"{pattern.name}: amplitude {pattern.amplitude:g} becomes on or off")
    return sentences


def amplitude_range(patterns: Sequence[Pattern]) -> tuple[float, float]:
    """Return the smallest and the largest amplitude above 0 of patterns; (0, 0) if none vibrates."""
    amplitudes = [
        amplitude
        for pattern in patterns
        if pattern.kind != "off"
        for amplitude in (pattern.amplitude, *_followed_amplitudes(pattern))
        if amplitude > 0
    ]
    return min(amplitudes, default=0.0), max(amplitudes, default=0.0)


def with_weakest(patterns: Sequence[Pattern], amplitude: float | None) -> tuple[Pattern, ...]:
    """Return patterns the weakest of which has a given amplitude, and the strongest its own.

    The amplitudes in between are mapped linearly. Their order stays: the strongest alarm remains so.

    Args:
        patterns: The haptic grammar of a procedure.
        amplitude: At most that of the strongest; None: leave them as they are.
    """
    if amplitude is None:
        return tuple(patterns)
    weakest, strongest = amplitude_range(patterns)
    share = (strongest - amplitude) / (strongest - weakest) if strongest > weakest else 0.0

    def mapped(value: float) -> float:
        return strongest - share * (strongest - value) if value > 0 else value

    def with_mapped(pattern: Pattern) -> Pattern:
        follow = tuple(
            replace(
                each, start=(each.start[0], mapped(each.start[1])), end=(each.end[0], mapped(each.end[1]))
            )
            if each.key == "amplitude"
            else each
            for each in pattern.follow
        )
        return replace(pattern, amplitude=mapped(pattern.amplitude), follow=follow)

    return tuple(pattern if pattern.kind == "off" else with_mapped(pattern) for pattern in patterns)


def _followed_amplitudes(pattern: Pattern) -> list[float]:
    follows = (follow for follow in pattern.follow if follow.key == "amplitude")
    return [amplitude for follow in follows for _, amplitude in (follow.start, follow.end)]


def _on_ns(pattern: Pattern) -> int:
    return round(pattern.on_ms * NS_PER_MS)


def _off_ns(pattern: Pattern) -> int:
    return round(pattern.off_ms * NS_PER_MS)


def _period_ns(pattern: Pattern) -> int:
    return _on_ns(pattern) + _off_ns(pattern)
