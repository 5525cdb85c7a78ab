"""Intervals of the real line: the values of a measure between bounds."""

from collections.abc import Iterable
from fractions import Fraction
from math import inf, isinf

from msgspec import Struct

__all__ = ["REAL_LINE", "Interval", "atoms"]


class Interval(Struct, frozen=True):
    """All values from low to high; each end is included or not. An infinite end never is."""

    low: float = -inf
    high: float = inf
    has_low: bool = False
    has_high: bool = False

    @classmethod
    def between(
        cls, *, at_most: float | None, below: float | None, at_least: float | None, above: float | None
    ) -> "Interval":
        """Return the values that satisfy the given bounds, as procedures write them."""
        low = at_least if at_least is not None else above if above is not None else -inf
        high = at_most if at_most is not None else below if below is not None else inf
        return cls(low, high, at_least is not None, at_most is not None)

    def __contains__(self, value: float | Fraction) -> bool:
        # Comparing a fraction with a float is exact, also with infinity.
        return (self.low < value or (self.has_low and value == self.low)) and (
            value < self.high or (self.has_high and value == self.high)
        )

    def union(self, following: "Interval") -> "Interval":
        """Return the union with the interval that follows this one."""
        return Interval(self.low, following.high, self.has_low, following.has_high)

    def can_be_at_most(self, other: "Interval") -> bool:
        """Return whether some value of this interval is at most some value of the other."""
        return self.low < other.high or (self.low == other.high and self.has_low and other.has_high)

    def intersection(self, other: "Interval") -> "Interval":
        """Return the values in both intervals, which must overlap."""
        low, lacks_low = max((self.low, not self.has_low), (other.low, not other.has_low))
        high, has_high = min((self.high, self.has_high), (other.high, other.has_high))
        return Interval(low, high, not lacks_low, has_high)

    def sample(self) -> float:
        """Return an example value of the interval."""
        if self.low == self.high:
            return self.low
        if isinf(self.low) and isinf(self.high):
            return 0.0
        if isinf(self.low):
            return self.high - 1.0
        if isinf(self.high):
            return self.low + 1.0
        return (self.low + self.high) / 2

    def offset_from(self, value: float) -> float:
        """Return the offset from a value to the nearer end of the interval; 0 if it contains the value."""
        if value in self:
            return 0.0
        return (self.low if value <= self.low else self.high) - value

    def describe(self, name: str) -> str:
        """Return the condition that a measure is in the interval: "0.7 < theta_deg <= 1.7"."""
        if self.low == self.high:
            return f"{name} = {self.low:g}"
        if isinf(self.low) and isinf(self.high):
            return f"any {name}"
        if isinf(self.low):
            return f"{name} {'<=' if self.has_high else '<'} {self.high:g}"
        if isinf(self.high):
            return f"{name} {'>=' if self.has_low else '>'} {self.low:g}"
        below, above = ("<=" if has_end else "<" for has_end in (self.has_low, self.has_high))
        return f"{self.low:g} {below} {name} {above} {self.high:g}"


REAL_LINE = Interval()


def atoms(bounds: Iterable[float], within: Interval = REAL_LINE) -> list[Interval]:
    """Partition an interval at bounds: the bounds themselves and the intervals between them, in order."""
    cuts = sorted({bound for bound in bounds if bound in within})
    if within.has_low and within.low not in cuts:
        cuts.insert(0, within.low)
    if within.has_high and within.high not in cuts:
        cuts.append(within.high)
    parts, low = [], within.low
    for cut in cuts:
        if low < cut:
            parts.append(Interval(low, cut))
        parts.append(Interval(cut, cut, True, True))
        low = cut
    if low < within.high:
        parts.append(Interval(low, within.high))
    return parts
