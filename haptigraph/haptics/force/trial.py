"""Try a force device: a soft wall below the hand, for some seconds, while the clutch is held."""

import math
from collections.abc import Callable, Sequence
from typing import Protocol

from msgspec import Struct

from haptigraph.clock import Clock
from haptigraph.haptics.force.fixture import Fixture
from haptigraph.haptics.force.messages import ForceInput
from haptigraph.messages import ForceSample

__all__ = ["WALL_N", "Tried", "WallTrial", "try_wall"]

WALL_N, STIFFNESS_N_PER_MM, BELOW_MM = 1.0, 0.2, 5.0
WAIT_NS, LENGTH_NS, PERIOD_NS = 30_000_000_000, 10_000_000_000, 30_000_000


class Tried(Protocol):
    """A force device, as `ForceProcess` is."""

    def send(self, message: ForceInput) -> None:
        """Take fixtures."""
        ...

    def take(self) -> Sequence[ForceSample]:
        """Return what it did since the last call."""
        ...


class WallTrial(Struct):
    """What a trial found."""

    has_begun: bool = False
    """Whether the clutch was ever held."""
    most_n: float = 0.0
    """The largest force."""
    deepest_mm: float = 0.0
    """How far the hand was beyond the wall."""


def try_wall(device: Tried, clock: Clock, announce: Callable[[str], None]) -> WallTrial:
    """Wait for the clutch, and put a wall below the hand until the clutch is released or the time is over.

    Args:
        device: The device; not closed.
        clock: Paces the trial.
        announce: Called with what the person should do, a sentence each.
    """
    trial = WallTrial()
    announce(
        "hold the handle, and hold its clutch button; nothing pushes before, and letting go ends the test"
    )
    wall: Fixture | None = None
    end_ns = clock.now_ns() + WAIT_NS
    while (now_ns := clock.now_ns()) < end_ns:
        clock.wait_until(now_ns + PERIOD_NS)
        samples = device.take()
        if not samples:
            continue
        newest = samples[-1]
        if wall is None and newest.is_engaged:
            wall, end_ns, trial.has_begun = _wall_below(newest), now_ns + LENGTH_NS, True
            announce(
                f"a soft wall lies {BELOW_MM:g} mm below the hand: feel it, slowly; at most {WALL_N:g} N"
            )
        elif wall is not None and not newest.is_engaged:
            break
        if wall is not None:
            device.send(ForceInput((wall,), newest.hand_mm, newest.stamp_ns, 1.0))
            for sample in samples:
                trial.most_n = max(trial.most_n, math.hypot(*sample.force_n))
                trial.deepest_mm = max(trial.deepest_mm, wall.point_mm[1] - sample.hand_mm[1])
    return trial


def _wall_below(sample: ForceSample) -> Fixture:
    """Return a horizontal wall below the hand, in the frame of the hand."""
    x, y, z = sample.hand_mm
    return Fixture(
        "plane",
        (x, y - BELOW_MM, z),
        (0.0, 1.0, 0.0),
        stiffness_n_per_mm=STIFFNESS_N_PER_MM,
        limit_n=WALL_N,
    )
