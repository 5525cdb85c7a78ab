"""Stretches of a number line: between which bounds a measure lies. Knows neither graphs nor rules."""

from collections.abc import Iterable
from math import inf, isinf

from msgspec import Struct

__all__ = ["EVERYTHING", "Interval", "atoms"]


class Interval(Struct, frozen=True):
    """All values from low to high; the ends belong to it or not. An infinite end never does."""

    low: float = -inf
    high: float = inf
    low_in: bool = False
    high_in: bool = False

    @classmethod
    def between(
        cls, *, at_most: float | None, below: float | None, at_least: float | None, above: float | None
    ) -> "Interval":
        """Return the values that satisfy the bounds given, as procedures write them."""
        low = at_least if at_least is not None else above if above is not None else -inf
        high = at_most if at_most is not None else below if below is not None else inf
        return cls(low, high, at_least is not None, at_most is not None)

    def __contains__(self, value: float) -> bool:
        return (self.low < value or (self.low_in and value == self.low)) and (
            value < self.high or (self.high_in and value == self.high)
        )

    def joined(self, later: "Interval") -> "Interval":
        """Return this interval together with the one that follows it."""
        return Interval(self.low, later.high, self.low_in, later.high_in)

    def reaches(self, other: "Interval") -> bool:
        """Tell whether some value of this interval is at most some value of the other."""
        return self.low < other.high or (self.low == other.high and self.low_in and other.high_in)

    def met(self, other: "Interval") -> "Interval":
        """Return the values that lie in both, which must share some."""
        low, low_in = max((self.low, not self.low_in), (other.low, not other.low_in))
        high, high_in = min((self.high, self.high_in), (other.high, other.high_in))
        return Interval(low, high, not low_in, high_in)

    def sample(self) -> float:
        """Return a value that lies in it, as an example."""
        if self.low == self.high:
            return self.low
        if isinf(self.low) and isinf(self.high):
            return 0.0
        if isinf(self.low):
            return self.high - 1.0
        if isinf(self.high):
            return self.low + 1.0
        return (self.low + self.high) / 2

    def way_from(self, value: float) -> float:
        """Return how far a value must move to come to its edge; 0 if it lies in it already."""
        if value in self:
            return 0.0
        return (self.low if value <= self.low else self.high) - value

    def said(self, name: str) -> str:
        """Say that a measure lies in it: "0.7 < theta_deg <= 1.7"."""
        if self.low == self.high:
            return f"{name} = {self.low:g}"
        if isinf(self.low) and isinf(self.high):
            return f"any {name}"
        if isinf(self.low):
            return f"{name} {'<=' if self.high_in else '<'} {self.high:g}"
        if isinf(self.high):
            return f"{name} {'>=' if self.low_in else '>'} {self.low:g}"
        below, above = ("<=" if is_in else "<" for is_in in (self.low_in, self.high_in))
        return f"{self.low:g} {below} {name} {above} {self.high:g}"


EVERYTHING = Interval()


def atoms(bounds: Iterable[float], within: Interval = EVERYTHING) -> list[Interval]:
    """Cut a stretch of the number line at bounds: the bounds themselves and what lies between, in order."""
    cuts = sorted({bound for bound in bounds if bound in within})
    if within.low_in and within.low not in cuts:
        cuts.insert(0, within.low)
    if within.high_in and within.high not in cuts:
        cuts.append(within.high)
    pieces, low = [], within.low
    for cut in cuts:
        if low < cut:
            pieces.append(Interval(low, cut))
        pieces.append(Interval(cut, cut, True, True))
        low = cut
    if low < within.high:
        pieces.append(Interval(low, within.high))
    return pieces
