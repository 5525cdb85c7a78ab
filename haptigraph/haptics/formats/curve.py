"""Curves over time: points (time [ms], value), joined by straight lines; two points at one time are a step.

Pure functions. Before its first and after its last point, a curve keeps that point's value.
"""

import itertools
from bisect import bisect_left, bisect_right
from collections.abc import Sequence

from msgspec import Struct

__all__ = [
    "NO_FREQUENCY",
    "Curve",
    "Layer",
    "constant",
    "cut",
    "reduced",
    "strongest",
    "value_after",
    "value_before",
]

Curve = tuple[tuple[float, float], ...]
NO_FREQUENCY: Curve = ()
"""The frequency is the device's choice."""
TOLERANCE = 1e-9


class Layer(Struct, frozen=True):
    """One of several vibrations at the same time; silent outside its amplitude's points."""

    amplitude: Curve
    frequency_hz: Curve = NO_FREQUENCY


def constant(value: float, start_ms: float, end_ms: float) -> Curve:
    """Return a curve of one value."""
    return ((start_ms, value), (end_ms, value))


def value_after(curve: Curve, time_ms: float, level: float = 0.0) -> float:
    """Return the value from a time on: the later one of a step; `level` if the curve has no points."""
    return _value(curve, bisect_right(curve, time_ms, key=_time) - 1, time_ms, level)


def value_before(curve: Sequence[tuple[float, float]], time_ms: float, level: float = 0.0) -> float:
    """Return the value up to a time: the earlier one of a step; `level` if the curve has no points."""
    index = bisect_left(curve, time_ms, key=_time)
    if index < len(curve) and curve[index][0] == time_ms:
        return curve[index][1]
    return _value(curve, index - 1, time_ms, level)


def reduced(curve: Sequence[tuple[float, float]]) -> Curve:
    """Return a curve without points that repeat, or lie on the line between their neighbours."""
    kept: list[tuple[float, float]] = []
    for point in curve:
        if kept and point == kept[-1]:
            continue
        while len(kept) > 1 and _is_between(kept[-2], kept[-1], point):
            kept.pop()
        kept.append(point)
    return tuple(kept)


def cut(curve: Curve, start_ms: float, end_ms: float) -> Curve:
    """Return the part of a curve between two times, without the steps at them."""
    if not curve:
        return curve
    inner = curve[bisect_right(curve, start_ms, key=_time) : bisect_left(curve, end_ms, key=_time)]
    first, last = (start_ms, value_after(curve, start_ms)), (end_ms, value_before(curve, end_ms))
    return reduced([first, *inner, last])


def strongest(layers: Sequence[Layer], end_ms: float) -> Layer:
    """Return the one vibration that follows the strongest of several at every time.

    Merges pairs of halves, as merge sort does: many layers that overlap cost little more than few.

    Args:
        layers: Vibrations, which may overlap; of equally strong ones, the one that started first counts.
        end_ms: Where the result ends; silence fills what no layer covers.
    """
    # of those that start together, the later one counts
    ordered = sorted((layer for layer in reversed(layers) if layer.amplitude), key=_start_ms)
    if not ordered:
        return Layer(constant(0.0, 0.0, end_ms))
    return _merged(ordered, end_ms)


def _merged(layers: Sequence[Layer], end_ms: float) -> Layer:
    """Return the strongest of layers in the order of their starts."""
    if len(layers) > 2:
        half = len(layers) // 2
        layers = [_merged(layers[:half], end_ms), _merged(layers[half:], end_ms)]
    times_ms = {0.0, end_ms}
    for layer in layers:
        times_ms |= {time_ms for curve in (layer.amplitude, layer.frequency_hz) for time_ms, _ in curve}
    ordered = sorted(time_ms for time_ms in times_ms if 0 <= time_ms <= end_ms)
    amplitude: list[tuple[float, float]] = []
    frequency_hz: list[tuple[float, float]] = []
    for start_ms, next_ms in itertools.pairwise(ordered):
        active = [layer for layer in layers if _start_ms(layer) <= start_ms < layer.amplitude[-1][0]]
        for part in _parts(active, start_ms, next_ms):
            amplitude += part.amplitude
            frequency_hz += part.frequency_hz
    amplitude = amplitude or [(0.0, 0.0), (end_ms, 0.0)]
    chosen = any(value for _, value in frequency_hz)
    return Layer(reduced(amplitude), reduced(frequency_hz) if chosen else NO_FREQUENCY)


def _parts(layers: Sequence[Layer], start_ms: float, end_ms: float) -> list[Layer]:
    """Return the stronger of at most two layers between two times without a point of either in between."""
    if not layers:
        return [Layer(constant(0.0, start_ms, end_ms))]
    first = max(layers, key=lambda layer: value_after(layer.amplitude, start_ms))
    last = max(layers, key=lambda layer: value_before(layer.amplitude, end_ms))
    ahead = value_after(first.amplitude, start_ms) - value_after(last.amplitude, start_ms)
    behind = value_before(last.amplitude, end_ms) - value_before(first.amplitude, end_ms)
    if ahead > TOLERANCE and behind > TOLERANCE:
        crossing_ms = start_ms + (end_ms - start_ms) * ahead / (ahead + behind)
        if start_ms < crossing_ms < end_ms:
            return [_part(first, start_ms, crossing_ms), _part(last, crossing_ms, end_ms)]
    return [_part(last if ahead <= TOLERANCE else first, start_ms, end_ms)]


def _part(layer: Layer, start_ms: float, end_ms: float) -> Layer:
    """Return a layer between two times; silence has no frequency."""
    if not value_after(layer.amplitude, start_ms) and not value_before(layer.amplitude, end_ms):
        return Layer(constant(0.0, start_ms, end_ms))
    curves = layer.amplitude, layer.frequency_hz or constant(0.0, start_ms, end_ms)
    return Layer(*(cut(curve, start_ms, end_ms) for curve in curves))


def _start_ms(layer: Layer) -> float:
    return layer.amplitude[0][0]


def _value(curve: Sequence[tuple[float, float]], index: int, time_ms: float, level: float) -> float:
    """Return the value at a time between the points `index` and `index` + 1."""
    if not curve:
        return level
    if index < 0 or index + 1 >= len(curve):
        return curve[0 if index < 0 else -1][1]
    (start_ms, start), (end_ms, end) = curve[index], curve[index + 1]
    return start + (end - start) * (time_ms - start_ms) / (end_ms - start_ms)


def _is_between(first: tuple[float, float], middle: tuple[float, float], last: tuple[float, float]) -> bool:
    """Return whether the middle of three points changes nothing."""
    (start_ms, start), (time_ms, value), (end_ms, end) = first, middle, last
    if start_ms == end_ms:
        return True
    if time_ms in (start_ms, end_ms):
        return False
    return abs(value - start - (end - start) * (time_ms - start_ms) / (end_ms - start_ms)) < TOLERANCE


def _time(point: tuple[float, float]) -> float:
    return point[0]
