"""An energy tank: it bounds the energy that a sampled and delayed force can put into a hand.

The force is held over each sample, so its work is force times displacement, exactly (passivity observer of
Ryu, Kim, Hannaford 2004; energy tanks: Ferraguti, Secchi, Fantuzzi 2013). If the delay is not known, but
bounded, the force that acted is one of those commanded within the bound; the tank pays for the worst of them.
It admits no force whose worst case until it can be withdrawn, a hand that moves away at its maximum speed,
exceeds its content. So its content never becomes negative, whatever the hand does below that speed.
"""

from collections import deque
from math import hypot
from typing import NamedTuple

from haptigraph.robot.pose import Vec3

__all__ = ["CAPACITY_MJ", "EnergyTank"]

CAPACITY_MJ = 4.0
"""Energy at the start. 1 mJ less than what is guaranteed, for errors of the readings."""
NS_PER_S = 1e9


class _Sent(NamedTuple):
    """A force that was commanded, and when the next one replaced it."""

    end_ns: int
    force_n: Vec3
    size_n: float


class EnergyTank:
    """Account for the work of every force, and limit the next one.

    Per exchange: `account` for what happened since the one before, then `admitted_n`, then `send`.

    Args:
        max_speed_mm_s: Of the hand.
        hold_ms: Longest time between two exchanges.
        damping_n_s_per_mm: The device's own mechanical damping, which dissipates what the force puts in.
    """

    def __init__(self, max_speed_mm_s: float, hold_ms: float, damping_n_s_per_mm: float = 0.0) -> None:
        self._max_speed_mm_s, self._hold_s = max_speed_mm_s, hold_ms / 1e3
        self._damping_n_s_per_mm = damping_n_s_per_mm
        self._past: deque[_Sent] = deque()
        self._acting, self._next = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        self._acting_n = self._next_n = 0.0
        self.content_mj = CAPACITY_MJ
        """Energy that may still be put into the hand, net."""

    def account(
        self, moved_mm: Vec3 | None, elapsed_ns: int, now_ns: int, delay_ns: int, elastic_mj: float
    ) -> None:
        """Pay for the time since the previous exchange.

        Args:
            moved_mm: Displacement of the hand; None if it is unknown: any below the maximum speed.
            elapsed_ns: Time since the previous exchange.
            now_ns: The present exchange.
            delay_ns: Bound of the delay.
            elastic_mj: Energy that the hand has stored in the fixtures, kept besides the capacity.
        """
        self._forget(now_ns - elapsed_ns - delay_ns)
        elapsed_s, most_n = (
            elapsed_ns / NS_PER_S,
            max([self._acting_n, *[sent.size_n for sent in self._past]]),
        )
        if moved_mm is None:
            self.content_mj -= most_n * self._max_speed_mm_s * elapsed_s
        else:
            x, y, z = moved_mm
            may_have_acted = [self._acting, *[sent.force_n for sent in self._past]]
            self.content_mj -= max([fx * x + fy * y + fz * z for fx, fy, fz in may_have_acted])
            if self._damping_n_s_per_mm and elapsed_s:
                self.content_mj += self._damping_n_s_per_mm * (x * x + y * y + z * z) / elapsed_s
        in_flight_mj = most_n * self._max_speed_mm_s * (self._hold_s + delay_ns / NS_PER_S)
        self.content_mj = min(self.content_mj, max(CAPACITY_MJ + elastic_mj, in_flight_mj))
        if self._past and self._past[-1].force_n == self._acting:
            self._past.pop()
        self._past.append(_Sent(now_ns, self._acting, self._acting_n))
        self._forget(now_ns - delay_ns + 1)
        self._acting, self._acting_n = self._next, self._next_n

    def admitted_n(self, now_ns: int, delay_ns: int) -> float:
        """Return the largest size of the next force whose worst case the tank can pay."""
        hold_s, budget, begin_s, later = self._hold_s, self.content_mj / self._max_speed_mm_s, 0.0, []
        pieces = self._envelope(now_ns, delay_ns)
        for end_s, size_n in (*pieces, (pieces[-1][0] + hold_s, 0.0)):
            budget -= max(min(end_s, hold_s) - begin_s, 0.0) * size_n  # until the next exchange
            if end_s > hold_s:
                later.append((end_s - max(begin_s, hold_s), size_n))
            begin_s = end_s
        return _largest(budget, later)

    def refill(self) -> None:
        """Fill the tank: the energy counts from now on."""
        self.content_mj = CAPACITY_MJ

    def send(self, force_n: Vec3) -> None:
        """Note the force that is passed to the next exchange."""
        self._next, self._next_n = force_n, hypot(*force_n)

    def _forget(self, until_ns: int) -> None:
        """Forget the forces that were replaced before a time."""
        while self._past and self._past[0].end_ns < until_ns:
            self._past.popleft()

    def _envelope(self, now_ns: int, delay_ns: int) -> list[tuple[float, float]]:
        """Return the largest force that may still act if nothing else is sent: until when [s], and its size.

        In order of time; sizes decrease. A force that may act in part of an exchange counts in all of it.
        """
        size_n, whole_s = self._acting_n, self._hold_s if delay_ns else 0.0
        pieces = [(self._hold_s + delay_ns / NS_PER_S + whole_s, size_n)]
        for end_ns, _, sent_n in reversed(self._past):
            if sent_n > size_n:
                size_n = sent_n
                pieces.append(((end_ns + delay_ns - now_ns) / NS_PER_S + whole_s, size_n))
        return pieces[::-1]


def _largest(budget: float, pieces: list[tuple[float, float]]) -> float:
    """Return the largest m for which the sum of duration * max(size, m) is within a budget; 0 if none is.

    Args:
        budget: Of that sum.
        pieces: (duration, size), in order of decreasing sizes; the last one has size 0.
    """
    left_s = sum([duration_s for duration_s, _ in pieces])
    largest = budget / left_s
    for duration_s, size_n in pieces[:-1]:
        budget -= duration_s * size_n
        left_s -= duration_s
        largest = min(largest, budget / left_s)
    return max(largest, 0.0)
