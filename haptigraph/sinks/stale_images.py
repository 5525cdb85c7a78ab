"""Decide which stale images a terminal shows one by one: of frequent ones only their number."""

from collections import deque

from haptigraph.messages import STALE_IMAGE, Fault, Step

__all__ = ["FREQUENT_STALE", "StaleImages", "is_stale"]

FREQUENT = 4
PERIOD_NS = 10_000_000_000
"""So many within this time are frequent; then their number is printed once in this time."""
LONG_NS = 1_000_000_000
"""A longer loss is printed in any case: it may be a camera that is gone."""
FREQUENT_STALE = (
    "images are late again and again: this machine is too slow or too busy, or the source is too slow; "
    "from now on only their number is printed, and no unknown state of less than 1 s"
)


class StaleImages:
    """Counts the stale images of one run."""

    def __init__(self) -> None:
        self.is_hidden = False
        """Whether the last step is one of a stale image that is not printed."""
        self._begun_ns = deque[int](maxlen=FREQUENT)
        self._was_stale = False
        self._counted_from_ns: int | None = None
        """Since when those are counted that are not printed; None: all are printed."""
        self._count = 0

    def add(self, step: Step) -> list[str]:
        """Take the next step; return what to print about the stale images that are not printed themselves."""
        stale, now_ns, lines = any(map(is_stale, step.faults)), step.stamp_ns, list[str]()
        if stale and not self._was_stale:
            self._begun_ns.append(now_ns)
            self._count += 1
            if self._counted_from_ns is None and self._are_frequent():
                self._counted_from_ns, self._count = now_ns, 1
                lines.append(FREQUENT_STALE)
        self._was_stale = stale
        if self._counted_from_ns is not None and now_ns - self._counted_from_ns >= PERIOD_NS:
            lines += self.counted() or ["images arrive in time again"]
            self._counted_from_ns = now_ns if self._count else None
            self._count = 0
        is_counted = self._counted_from_ns is not None
        self.is_hidden = stale and is_counted and now_ns - self._begun_ns[-1] < LONG_NS
        return lines

    def counted(self) -> list[str]:
        """Return how many stale images were counted since the last line about them; nothing if none."""
        is_some = self._counted_from_ns is not None and self._count > 0
        return [f"{self._count} x source: {STALE_IMAGE}"] if is_some else []

    def _are_frequent(self) -> bool:
        begun_ns = self._begun_ns
        return len(begun_ns) == FREQUENT and begun_ns[-1] - begun_ns[0] <= PERIOD_NS


def is_stale(fault: Fault) -> bool:
    """Return whether a fault is that of a source without a new image in time."""
    return fault.where == "source" and fault.message.startswith(STALE_IMAGE)
