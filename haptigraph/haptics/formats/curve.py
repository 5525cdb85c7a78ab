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
MAX_SPLITS = 8
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


def value_before(curve: Curve, time_ms: float, level: float = 0.0) -> float:
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

    Args:
        layers: Vibrations, which may overlap.
        end_ms: Where the result ends; silence fills what no layer covers.
    """
    layers = [layer for layer in layers if layer.amplitude]
    spans = [(layer.amplitude[0][0], layer.amplitude[-1][0]) for layer in layers]
    times_ms = {0.0, end_ms}
    for layer in layers:
        times_ms |= {time_ms for curve in (layer.amplitude, layer.frequency_hz) for time_ms, _ in curve}
    ordered = sorted(time_ms for time_ms in times_ms if 0 <= time_ms <= end_ms)
    waiting = sorted(range(len(layers)), key=lambda index: spans[index][0], reverse=True)
    active: list[int] = []
    amplitude: list[tuple[float, float]] = []
    frequency_hz: list[tuple[float, float]] = []
    for start_ms, next_ms in itertools.pairwise(ordered):
        while waiting and spans[waiting[-1]][0] <= start_ms:
            active.append(waiting.pop())
        active = [index for index in active if spans[index][1] > start_ms]
        for part in _parts([layers[index] for index in active], start_ms, next_ms, MAX_SPLITS):
            amplitude += part.amplitude
            frequency_hz += part.frequency_hz
    amplitude = amplitude or [(0.0, 0.0), (end_ms, 0.0)]
    chosen = any(value for _, value in frequency_hz)
    return Layer(reduced(amplitude), reduced(frequency_hz) if chosen else NO_FREQUENCY)


def _parts(layers: Sequence[Layer], start_ms: float, end_ms: float, splits: int) -> list[Layer]:
    """Return the strongest between two times without a point of any layer in between."""
    if not layers:
        return [Layer(constant(0.0, start_ms, end_ms))]
    first = max(layers, key=lambda layer: value_after(layer.amplitude, start_ms))
    last = max(layers, key=lambda layer: value_before(layer.amplitude, end_ms))
    ahead = value_after(first.amplitude, start_ms) - value_after(last.amplitude, start_ms)
    behind = value_before(last.amplitude, end_ms) - value_before(first.amplitude, end_ms)
    if splits and ahead > TOLERANCE and behind > TOLERANCE:
        crossing_ms = start_ms + (end_ms - start_ms) * ahead / (ahead + behind)
        if start_ms < crossing_ms < end_ms:
            before = _parts(layers, start_ms, crossing_ms, splits - 1)
            return before + _parts(layers, crossing_ms, end_ms, splits - 1)
    winner = last if ahead <= TOLERANCE else first
    if not value_after(winner.amplitude, start_ms) and not value_before(winner.amplitude, end_ms):
        return [Layer(constant(0.0, start_ms, end_ms))]
    curves = winner.amplitude, winner.frequency_hz or constant(0.0, start_ms, end_ms)
    return [Layer(*(cut(curve, start_ms, end_ms) for curve in curves))]


def _value(curve: Curve, index: int, time_ms: float, level: float) -> float:
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
