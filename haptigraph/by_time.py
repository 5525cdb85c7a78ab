"""Index a sequence by time: `[2.5]`, `[2.5:4]`, in seconds."""

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from typing import Generic, Protocol, TypeVar, overload

__all__ = ["ByTime", "Indexed"]

T = TypeVar("T", covariant=True)


class Indexed(Protocol[T]):
    """Items by number, and slices of them."""

    @overload
    def __getitem__(self, number: int, /) -> T: ...

    @overload
    def __getitem__(self, number: slice, /) -> Sequence[T]: ...


class ByTime(Generic[T]):
    """The items of a sequence, indexed by time in seconds.

    `[2.5]` is the item that was current at 2.5 s; `[2.5:4]` are those from 2.5 s up to, not including, 4 s.

    Args:
        items: The items.
        time_s: When each began, ascending from 0.
    """

    def __init__(self, items: Indexed[T], time_s: Sequence[float]) -> None:
        self._items, self._time_s = items, time_s

    def __repr__(self) -> str:
        return f"<ByTime of {len(self._time_s)} items, {self._valid()}>"

    @overload
    def __getitem__(self, at_s: float) -> T: ...

    @overload
    def __getitem__(self, at_s: slice) -> Sequence[T]: ...

    def __getitem__(self, at_s: float | slice) -> T | Sequence[T]:
        if not isinstance(at_s, slice):
            if not self._time_s or not 0 <= at_s <= self._time_s[-1]:
                raise IndexError(f"nothing at {at_s:g} s; valid: {self._valid()}")
            return self._items[bisect_right(self._time_s, at_s) - 1]
        if at_s.step is not None:
            raise ValueError(
                f"a slice of time has no step, found {at_s.step}; slice the list that it returns"
            )
        first = 0 if at_s.start is None else bisect_left(self._time_s, at_s.start)
        end = len(self._time_s) if at_s.stop is None else bisect_left(self._time_s, at_s.stop)
        return self._items[first:end]

    def _valid(self) -> str:
        return f"0 to {self._time_s[-1]:.3f} s" if self._time_s else "none"
