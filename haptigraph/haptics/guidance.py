"""Continuous guidance: patterns whose amplitude, frequency or pulse rate follows a measure of the scene.

Turns a pattern with `follow` tables and the current measures into a pattern of plain numbers. Noise within
the dead band of the last followed value changes nothing.
"""

from collections.abc import Mapping

from msgspec.structs import replace

from haptigraph.messages import Follow, Pattern

__all__ = ["Guidance", "followed"]


def followed(follow: Follow, value: float) -> float:
    """Return the number of a pattern for a value of the measure.

    Args:
        follow: The mapping from measure to number.
        value: The measure, in its unit.
    """
    (first, low), (last, high) = follow.start, follow.end
    fraction = min(max((value - first) / (last - first), 0.0), 1.0)
    return low + float(fraction**follow.curve) * (high - low)


class Guidance:
    """Resolve the `follow` tables of patterns."""

    def __init__(self) -> None:
        self._followed: dict[Follow, float] = {}

    def __call__(self, pattern: Pattern, measures: Mapping[str, float]) -> Pattern:
        """Return a pattern with the current values of the numbers that follow a measure.

        A number whose measure is undefined keeps the value of the pattern.
        """
        if not pattern.follow:
            return pattern
        plain = replace(pattern, follow=())
        for follow in pattern.follow:
            value = measures.get(follow.measure)
            if value is not None:
                plain = _changed(plain, follow.key, followed(follow, self._steady(follow, value)))
        return plain

    def reset(self) -> None:
        """Forget the followed values."""
        self._followed.clear()

    def _steady(self, follow: Follow, value: float) -> float:
        """Return the last followed value if the measure is within its dead band, else the measure."""
        last = self._followed.get(follow)
        if last is None or abs(value - last) > follow.dead_band:
            self._followed[follow] = last = value
        return last


def _changed(pattern: Pattern, key: str, number: float) -> Pattern:
    if key == "rate_hz":
        return replace(pattern, off_ms=1000.0 / number - pattern.on_ms)
    return replace(pattern, **{key: number})
