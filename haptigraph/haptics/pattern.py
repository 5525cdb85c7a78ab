"""What a haptic command feels like at any moment: patterns as amplitude over time.

Pure functions of time; they know no device and no clock.
"""

from haptigraph.messages import Capabilities, HapticCommand, Pattern

__all__ = ["amplitude_at", "beyond", "duration_ns", "next_change_ns"]

NS_PER_MS = 1_000_000


def duration_ns(pattern: Pattern) -> int | None:
    """Return how long a pattern lasts [ns]; None for those that go on until something else is felt."""
    if pattern.kind != "bursts":
        return None
    return pattern.count * _on_ns(pattern) + (pattern.count - 1) * _off_ns(pattern)


def amplitude_at(command: HapticCommand, stamp_ns: int) -> float:
    """Return the amplitude of a command at a moment, in [0, 1]."""
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


def next_change_ns(command: HapticCommand, stamp_ns: int) -> int | None:
    """Return the first moment after `stamp_ns` at which the amplitude may change; None if it stays."""
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


def beyond(pattern: Pattern, capabilities: Capabilities) -> list[str]:
    """Say, a sentence each, what of a pattern a device cannot do."""
    sentences = []
    if pattern.kind != "off" and capabilities.frequency_range_hz is None and pattern.frequency_hz:
        sentences.append(f"{pattern.name}: {pattern.frequency_hz:g} Hz cannot be chosen")
    if capabilities.frequency_range_hz is not None and pattern.frequency_hz:
        low, high = capabilities.frequency_range_hz
        if not low <= pattern.frequency_hz <= high:
            sentences.append(
                f"{pattern.name}: {pattern.frequency_hz:g} Hz lies outside {low:g} to {high:g} Hz"
            )
    if 0 < pattern.on_ms < capabilities.shortest_on_ms:
        shortest = capabilities.shortest_on_ms
        sentences.append(f"{pattern.name}: {pattern.on_ms:g} ms are not felt, {shortest:g} ms are")
    if capabilities.amplitude_levels == 1 and 0 < pattern.amplitude < 1:
        sentences.append(f"{pattern.name}: amplitude {pattern.amplitude:g} becomes on or off")
    return sentences


def _on_ns(pattern: Pattern) -> int:
    return round(pattern.on_ms * NS_PER_MS)


def _off_ns(pattern: Pattern) -> int:
    return round(pattern.off_ms * NS_PER_MS)


def _period_ns(pattern: Pattern) -> int:
    return _on_ns(pattern) + _off_ns(pattern)
