"""Fit a pattern of the haptic grammar to an envelope: off, continuous, pulses or bursts."""

import itertools

from msgspec import Struct

from haptigraph.haptics.formats.curve import Curve, cut
from haptigraph.haptics.formats.envelope import Difference, Envelope, difference, edges_ms, enveloped, plain
from haptigraph.messages import Pattern

__all__ = ["MAX_TIMING_MS", "Fit", "fit"]

MAX_AMPLITUDE, MAX_TIMING_MS = 0.01, 2.0
SILENT = 1e-3
MIN_MS = 1.0  # of on_ms and off_ms in a procedure


class Fit(Struct, frozen=True):
    """A pattern for an envelope."""

    pattern: Pattern
    error: Difference
    """From the envelope to what the pattern plays."""

    @property
    def is_exact(self) -> bool:
        """Whether the pattern plays the envelope, within 1 % of its amplitude and 2 ms."""
        return self.error.amplitude <= MAX_AMPLITUDE and self.error.timing_ms <= MAX_TIMING_MS


def fit(envelope: Envelope, name: str) -> Fit:
    """Return a pattern that vibrates where the amplitude is above about half of its peak, at its mean there.

    An envelope that repeats becomes pulses or continuous, another one bursts.
    """
    envelope = plain(envelope)
    edges = edges_ms(envelope)
    gates = list(zip(edges[::2], edges[1::2], strict=True))
    silent = envelope.peak < SILENT or not gates
    pattern = Pattern(name, "off") if silent else _vibration(envelope, gates, name)
    return Fit(pattern, difference(envelope, enveloped(pattern, envelope.duration_ms)))


def _vibration(envelope: Envelope, gates: list[tuple[float, float]], name: str) -> Pattern:
    amplitude = round(_mean(envelope.amplitude, gates), 4)
    frequency_hz = round(_mean(envelope.frequency_hz, gates), 1) if envelope.frequency_hz else 0.0
    on_ms = sum(off - on for on, off in gates) / len(gates)
    if envelope.repeats and len(gates) == 1 and envelope.duration_ms - on_ms < MIN_MS:
        return Pattern(name, "continuous", amplitude, frequency_hz)
    if len(gates) > 1:
        period_ms = (gates[-1][0] - gates[0][0]) / (len(gates) - 1)
    else:  # a single burst has no pause after it
        period_ms = envelope.duration_ms if envelope.repeats else 2 * on_ms
    on_ms = max(round(on_ms, 2), MIN_MS)
    off_ms = max(round(period_ms - on_ms, 2), MIN_MS)
    if envelope.repeats:
        return Pattern(name, "pulses", amplitude, frequency_hz, on_ms, off_ms)
    return Pattern(name, "bursts", amplitude, frequency_hz, on_ms, off_ms, len(gates))


def _mean(curve: Curve, gates: list[tuple[float, float]]) -> float:
    """Return the mean of a curve over several spans of time."""
    area = sum(_area(curve, on, off) for on, off in gates)
    return area / sum(off - on for on, off in gates)


def _area(curve: Curve, start_ms: float, end_ms: float) -> float:
    part = cut(curve, start_ms, end_ms)
    pairs = itertools.pairwise(part)
    return sum((until - since) * (first + last) / 2 for (since, first), (until, last) in pairs)
