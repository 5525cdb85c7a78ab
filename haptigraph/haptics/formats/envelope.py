"""The form that all formats share: amplitude and frequency over time, with transients.

Turns a pattern into such an envelope, cuts an envelope where it steps, and compares two of them.
"""

import itertools
import math
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence

from msgspec import Struct

from haptigraph.haptics.formats.curve import (
    NO_FREQUENCY,
    Curve,
    Layer,
    constant,
    cut,
    strongest,
    value_after,
    value_before,
)
from haptigraph.haptics.pattern import NS_PER_MS, duration_ns
from haptigraph.messages import Pattern

__all__ = [
    "MAX_MS",
    "TRANSIENT_MS",
    "Difference",
    "Envelope",
    "Transient",
    "difference",
    "edges_ms",
    "enveloped",
    "pieces",
    "plain",
]

MAX_MS = 180_000.0
"""Longest file, and longest export."""
TRANSIENT_MS = 22.0
"""How long a transient is played; formats do not say it. That of MPEG's reference software."""
CLOSE_MS = 0.5
"""Around steps and ends, nothing is compared for this time at least."""
MAX_AWAY_MS = 10.0
"""Steps further apart do not correspond; the amplitude is compared everywhere."""
EDGE_SHARE = 0.47  # not a half, which files often have as a level


class Transient(Struct, frozen=True):
    """A click at one time; its duration is the device's choice."""

    time_ms: float
    amplitude: float
    frequency_hz: float = 0.0
    """0: the device's choice."""


class Envelope(Struct, frozen=True):
    """A vibration as it is in a file."""

    amplitude: Curve
    """In [0, 1], from 0 ms to the end."""
    frequency_hz: Curve = NO_FREQUENCY
    """0, or no points: the device's choice."""
    transients: tuple[Transient, ...] = ()
    repeats: bool = False
    """Whether it begins again at its end until it is stopped."""
    notes: tuple[str, ...] = ()
    """What of the file is not in here, a clause each."""

    @property
    def duration_ms(self) -> float:
        """Where it ends."""
        return self.amplitude[-1][0]

    @property
    def peak(self) -> float:
        """The largest amplitude, transients included."""
        return max(value for value in (*_values(self.amplitude), *(one.amplitude for one in self.transients)))


class Difference(Struct, frozen=True):
    """How far two envelopes are apart."""

    amplitude: float
    """Largest difference in amplitude between steps, as a share of the first one's peak."""
    timing_ms: float
    """Largest difference between corresponding steps, or between the ends; infinite if the rhythm differs."""
    frequency_hz: float
    """Largest difference in frequency while both vibrate; infinite if only one states a frequency."""


def enveloped(pattern: Pattern, length_ms: float) -> Envelope:
    """Return what a pattern plays.

    Args:
        pattern: Numbers that follow a measure are taken at their plain values.
        length_ms: For how long one that does not end by itself is played, to the nearest whole period.
    """
    ends_ns = duration_ns(pattern)
    period_ms = pattern.on_ms + pattern.off_ms
    count = pattern.count if ends_ns is not None else max(1, round(length_ms / period_ms)) if period_ms else 0
    end_ms = ends_ns / NS_PER_MS if ends_ns is not None else count * period_ms if count else length_ms
    repeats = ends_ns is None
    if pattern.kind == "off":
        return Envelope(constant(0.0, 0.0, end_ms), repeats=repeats)
    frequency_hz = constant(pattern.frequency_hz, 0.0, end_ms) if pattern.frequency_hz else NO_FREQUENCY
    if pattern.kind == "continuous":
        return Envelope(constant(pattern.amplitude, 0.0, end_ms), frequency_hz, repeats=repeats)
    points: list[tuple[float, float]] = []
    for number in range(count):
        on_ms = number * period_ms
        off_ms = on_ms + pattern.on_ms
        points += [(on_ms, 0.0)] if number else []
        points += [(on_ms, pattern.amplitude), (off_ms, pattern.amplitude)]
        points += [(off_ms, 0.0)] if off_ms < end_ms else []
    points += [(end_ms, 0.0)] if repeats else []
    return Envelope(tuple(points), frequency_hz, repeats=repeats)


def plain(envelope: Envelope) -> Envelope:
    """Return an envelope with each transient as a burst of `TRANSIENT_MS`."""
    if not envelope.transients:
        return envelope
    end_ms = max(envelope.duration_ms, max(one.time_ms for one in envelope.transients) + TRANSIENT_MS)
    layers = [Layer(envelope.amplitude, envelope.frequency_hz)]
    for one in envelope.transients:
        until_ms = one.time_ms + TRANSIENT_MS
        frequency_hz = constant(one.frequency_hz, one.time_ms, until_ms)
        layers.append(Layer(constant(one.amplitude, one.time_ms, until_ms), frequency_hz))
    merged = strongest(layers, end_ms)
    return Envelope(merged.amplitude, merged.frequency_hz, repeats=envelope.repeats, notes=envelope.notes)


def pieces(envelope: Envelope) -> list[Layer]:
    """Return an envelope without its transients, cut where amplitude or frequency step.

    Pauses are left out, except one at the end, which states where the file ends.
    """
    curves = envelope.amplitude, envelope.frequency_hz
    steps_ms = {time_ms for curve in curves for time_ms in _steps_ms(curve)}
    edges_ms = {0.0, envelope.duration_ms} | steps_ms | set(_rest_ms(envelope.amplitude))
    ordered = sorted(time_ms for time_ms in edges_ms if time_ms <= envelope.duration_ms)
    found = []
    for start_ms, end_ms in itertools.pairwise(ordered):
        piece = Layer(cut(envelope.amplitude, start_ms, end_ms), cut(envelope.frequency_hz, start_ms, end_ms))
        if any(_values(piece.amplitude)) or end_ms == envelope.duration_ms:
            found.append(piece)
    return found


def difference(first: Envelope, second: Envelope) -> Difference:
    """Return how far a second envelope is from a first, both as they are played."""
    first, second = plain(first), plain(second)
    peak = max(_values(first.amplitude)) or 1.0
    edges = edges_ms(first), edges_ms(second)
    timing_ms = abs(first.duration_ms - second.duration_ms)
    margin_ms = 0.0
    if len(edges[0]) != len(edges[1]):
        timing_ms = math.inf
    elif edges[0]:
        away_ms = max(abs(a - b) for a, b in zip(*edges, strict=True))
        timing_ms = max(timing_ms, away_ms)
        margin_ms = away_ms if away_ms < MAX_AWAY_MS else 0.0
    near = _near(first, second, margin_ms)
    amplitude, frequency_hz = 0.0, 0.0
    for value, time_ms in _moments(first, second, near):
        a, b = value(first.amplitude, time_ms), value(second.amplitude, time_ms)
        amplitude = max(amplitude, abs(a - b))
        if a > peak / 100 and b > peak / 100:
            hz = value(first.frequency_hz, time_ms), value(second.frequency_hz, time_ms)
            apart_hz = abs(hz[0] - hz[1]) if all(hz) or not any(hz) else math.inf
            frequency_hz = max(frequency_hz, apart_hz)
    return Difference(amplitude / peak, timing_ms, frequency_hz)


def _near(first: Envelope, second: Envelope, margin_ms: float) -> list[tuple[float, float]]:
    """Return the times around steps [ms] in which nothing is compared, in order, without overlap."""
    curves = first.amplitude, second.amplitude, first.frequency_hz, second.frequency_hz
    spans = [(time_ms, 0.0) for curve in curves for time_ms in _steps_ms(curve)]
    spans += [(time_ms, 0.0) for time_ms in (0.0, first.duration_ms, second.duration_ms)]
    if margin_ms:
        spans += [(time_ms, margin_ms) for each in (first, second) for time_ms in edges_ms(each)]
    found: list[tuple[float, float]] = []
    for start_ms, until_ms in sorted((at - wide - CLOSE_MS, at + wide + CLOSE_MS) for at, wide in spans):
        if found and start_ms <= found[-1][1]:
            found[-1] = (found[-1][0], max(until_ms, found[-1][1]))
        else:
            found.append((start_ms, until_ms))
    return found


def _moments(
    first: Envelope, second: Envelope, near: Sequence[tuple[float, float]]
) -> Iterator[tuple[Callable[[Curve, float], float], float]]:
    """Yield when to compare two envelopes: before and after each point of their curves, not near a step."""
    end_ms = min(first.duration_ms, second.duration_ms)
    curves = (first.amplitude, second.amplitude, first.frequency_hz, second.frequency_hz)
    times_ms = {time_ms for curve in curves for time_ms, _ in curve} | {
        time_ms for pair in near for time_ms in pair
    }
    for time_ms in sorted(time_ms for time_ms in times_ms if 0 <= time_ms <= end_ms):
        index = bisect_right(near, (time_ms, math.inf)) - 1
        start_ms, until_ms = near[index] if index >= 0 else (-math.inf, -math.inf)
        if time_ms > 0 and not start_ms < time_ms <= until_ms:
            yield value_before, time_ms
        if time_ms < end_ms and not start_ms <= time_ms < until_ms:
            yield value_after, time_ms


def edges_ms(envelope: Envelope) -> list[float]:
    """Return when the amplitude crosses about half of its peak, in order: on, off, on ... [ms]."""
    level = EDGE_SHARE * max(_values(envelope.amplitude))
    found: list[float] = []
    if not level:
        return found
    previous_ms, previous = 0.0, 0.0
    for time_ms, value in envelope.amplitude:
        if (value > level) != bool(len(found) % 2):
            share = (level - previous) / (value - previous)
            found.append(previous_ms + share * (time_ms - previous_ms))
        previous_ms, previous = time_ms, value
    if len(found) % 2:
        found = [*found, envelope.duration_ms] if found[-1] < envelope.duration_ms else found[:-1]
    return found


def _values(curve: Curve) -> list[float]:
    return [value for _, value in curve]


def _steps_ms(curve: Curve) -> list[float]:
    return [start_ms for (start_ms, _), (end_ms, _) in itertools.pairwise(curve) if start_ms == end_ms]


def _rest_ms(amplitude: Curve) -> list[float]:
    """Return where silence begins and ends."""
    pairs = itertools.pairwise(amplitude)
    return [time_ms for pair in pairs if not any(_values(pair)) for time_ms, _ in pair]
