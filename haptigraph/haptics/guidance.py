"""Continuous guidance: patterns whose amplitude, frequency or pulse rate follows a measure of the scene.

Turns a pattern with `follow` tables and the measures of a moment into a pattern of plain numbers. Remembers
the measure it last followed, so that noise within the dead band changes nothing. Knows no rule, and no limit
but what the table says: the guard has the others.
"""

from collections.abc import Mapping

from msgspec.structs import replace

from haptigraph.messages import Follow, Pattern

__all__ = ["Guidance", "followed"]


def followed(follow: Follow, value: float) -> float:
    """Return the number that goes with a value of the measure.

    Args:
        follow: What follows what.
        value: Of the measure, in its unit.
    """
    (first, low), (last, high) = follow.start, follow.end
    share = min(max((value - first) / (last - first), 0.0), 1.0)
    return low + float(share**follow.curve) * (high - low)


class Guidance:
    """Say what patterns with `follow` tables are at any moment."""

    def __init__(self) -> None:
        self._followed: dict[Follow, float] = {}

    def __call__(self, pattern: Pattern, measures: Mapping[str, float]) -> Pattern:
        """Return a pattern with the numbers that follow a measure as they are now.

        A number whose measure is not known keeps what the pattern says.
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
        """Forget what was followed."""
        self._followed.clear()

    def _steady(self, follow: Follow, value: float) -> float:
        """Return the measure without what lies within the dead band of what was followed last."""
        last = self._followed.get(follow)
        if last is None or abs(value - last) > follow.dead_band:
            self._followed[follow] = last = value
        return last


def _changed(pattern: Pattern, key: str, number: float) -> Pattern:
    if key == "rate_hz":
        return replace(pattern, off_ms=1000.0 / number - pattern.on_ms)
    return replace(pattern, **{key: number})
