"""Turn fixtures and the motion of a hand into a force, once per exchange with the device. Deterministic.

    reading = device.exchange(force_n)
    force_n = renderer.step(reading, now_ns)

The force is within all limits, sets in softly, is paid for by an energy tank, and is released on any fault.
The caller passes the time.
"""

import math
from collections.abc import Sequence

from msgspec.structs import replace

from haptigraph.haptics.force.blend import FixtureBlend
from haptigraph.haptics.force.fixture import Fixture
from haptigraph.haptics.force.interface import ForceCapabilities, HandReading
from haptigraph.haptics.force.tank import EnergyTank
from haptigraph.robot.pose import Vec3

__all__ = ["MAX_GAP_MS", "MAX_RISE_N_PER_S", "RELEASE_MS", "RESTART_MS", "SOFT_START_MS", "ForceRenderer"]

RELEASE_MS = 10.0
"""A force that is released decreases to 0 within this time, linearly."""
RESTART_MS = 250.0
"""A fault must have been over for this time before any force is exerted again."""
SOFT_START_MS = 200.0
"""The force grows to its full size within this time after the clutch was engaged, or after a fault."""
MAX_RISE_N_PER_S = 100.0
MAX_GAP_MS = 20.0
"""Longest time without an exchange."""
STALE_MS = 8.0  # age of a reading beyond the device's delay
JUMP_MM = 0.2  # beyond what the maximum speed explains
DELAY_PERIODS = 1.5  # sampling and holding delay a force by 1.5 periods
DAMPING_SHARE = 2.0  # of what makes up for the delay of a slow hand
MAX_ADDED_DAMPING_N_S_PER_MM = 0.02
REFILL_MS = 500.0
NS_PER_MS = 1_000_000
NO_FORCE: Vec3 = (0.0, 0.0, 0.0)
NO_FIXTURES = "no fixtures have arrived"


class ForceRenderer:
    """Render fixtures for one device.

    A spring that acts late puts energy into the hand; damping in proportion to stiffness and delay takes it
    out again (after Colgate and Schenkel 1997). Fixtures with a surface get at least that damping, and no
    more stiffness than what `MAX_ADDED_DAMPING_N_S_PER_MM` suffices for. So the tank is seldom needed.

    The tank is refilled while the clutch is released.

    Args:
        capabilities: Of the device.
        max_force_n: Limit of the force, besides that of the device.
        deadman_ms: The force is released if no fixtures arrive for this time.
    """

    def __init__(
        self, capabilities: ForceCapabilities, max_force_n: float = math.inf, deadman_ms: float = 150.0
    ) -> None:
        period_ms = 1000.0 / capabilities.rate_hz
        self._max_n = min(capabilities.max_force_n, max_force_n)
        self._max_speed_mm_s = capabilities.max_speed_mm_s
        self._deadman_ns = round(deadman_ms * NS_PER_MS)
        self._delay_ns = round(capabilities.delay_ms * NS_PER_MS)
        self._damping_s = DAMPING_SHARE * (DELAY_PERIODS * period_ms + capabilities.delay_ms) / 1e3
        self._hold_ns = round(2 * period_ms * NS_PER_MS)
        self._tank = EnergyTank(self._max_speed_mm_s, 2 * period_ms, capabilities.damping_n_s_per_mm)
        self._blend = FixtureBlend()
        self._taken_ns: int | None = None
        self._called_ns: int | None = None
        self._last: HandReading | None = None
        """The reading before, if it was valid."""
        self._sent = self._released_from = NO_FORCE
        self._released_ns = self._blocked_until_ns = self._started_ns = -(10**18)
        self.problem = ""
        """The fault because of which the force is released; empty: none."""
        self.released_because = NO_FIXTURES
        """Why no force is exerted, also without a fault; empty while fixtures may push."""

    @property
    def tank_mj(self) -> float:
        """Content of the energy tank."""
        return self._tank.content_mj

    def take(self, fixtures: Sequence[Fixture], stamp_ns: int, now_ns: int) -> None:
        """Take the fixtures of one image, in the frame of the hand; none: nothing is to be exerted.

        Args:
            fixtures: They replace all earlier ones.
            stamp_ns: Of the image. One that is older than the dead-man time is ignored.
            now_ns: The present.
        """
        if now_ns - stamp_ns < self._deadman_ns:
            self._taken_ns = now_ns
            self._blend.take([self._damped(fixture) for fixture in fixtures], now_ns)

    def step(self, reading: HandReading, now_ns: int) -> Vec3:
        """Return the force to pass to the next exchange [N].

        Args:
            reading: Of the previous exchange.
            now_ns: The present.
        """
        elapsed_ns = 0 if self._called_ns is None else now_ns - self._called_ns
        moved_mm = self._moved_mm(reading, elapsed_ns)
        delay_ns = max(self._delay_ns, now_ns - reading.stamp_ns - self._hold_ns)
        elastic_mj = 0.0 if moved_mm is None else self._elastic_mj(reading, now_ns)
        self._tank.account(moved_mm, elapsed_ns, now_ns, delay_ns, elastic_mj)
        self._judge(reading, moved_mm, elapsed_ns, now_ns)
        wanted_n = self._wanted_n(reading, elapsed_ns, now_ns)
        self._sent = _shortened(wanted_n, self._tank.admitted_n(now_ns, delay_ns))
        self._tank.send(self._sent)
        self._last, self._called_ns = reading if _is_finite(reading) else None, now_ns
        return self._sent

    def release(self, because: str, now_ns: int) -> None:
        """Release the force because of a fault that only the caller knows, such as one of the device."""
        self.problem = self.problem or because
        self._blocked_until_ns = now_ns + round(RESTART_MS * NS_PER_MS)
        self._let_go(because, now_ns)

    def _damped(self, fixture: Fixture) -> Fixture:
        """Return a fixture with the damping that its stiffness needs, within limits of both."""
        stiffness = min(fixture.stiffness_n_per_mm, MAX_ADDED_DAMPING_N_S_PER_MM / self._damping_s)
        return replace(
            fixture,
            stiffness_n_per_mm=stiffness,
            damping_n_s_per_mm=max(fixture.damping_n_s_per_mm, self._damping_s * stiffness),
        )

    def _moved_mm(self, reading: HandReading, elapsed_ns: int) -> Vec3 | None:
        """Return the displacement since the reading before; None if the readings do not tell it."""
        if self._last is None or not _is_finite(reading):
            return None
        moved_mm = _difference(reading.position_mm, self._last.position_mm)
        since_ns = max(elapsed_ns, reading.stamp_ns - self._last.stamp_ns)
        is_possible = math.hypot(*moved_mm) <= self._max_speed_mm_s * since_ns / 1e9 + JUMP_MM
        return moved_mm if is_possible else None

    def _judge(self, reading: HandReading, moved_mm: Vec3 | None, elapsed_ns: int, now_ns: int) -> None:
        """Release the force on a fault, without clutch or fixtures; else start again, in time."""
        fault = self._fault(reading, moved_mm, elapsed_ns, now_ns)
        if fault:
            self.release(fault, now_ns)
        elif self._taken_ns is None:
            self._let_go(NO_FIXTURES, now_ns)
        elif not reading.engaged:
            self._let_go("the clutch is released", now_ns)
            if now_ns >= self._released_ns + self._delay_ns + REFILL_MS * NS_PER_MS:
                self._tank.refill()
        elif (
            self.released_because
            and now_ns >= self._blocked_until_ns
            and now_ns >= self._released_ns + RELEASE_MS * NS_PER_MS
        ):
            self.problem = self.released_because = ""
            self._started_ns = now_ns

    def _fault(self, reading: HandReading, moved_mm: Vec3 | None, elapsed_ns: int, now_ns: int) -> str:
        """Return what is wrong with the hand, the loop or the fixtures; empty: nothing."""
        if not _is_finite(reading):
            return "the device reports a position or a velocity that is not a number"
        if elapsed_ns > MAX_GAP_MS * NS_PER_MS:
            return f"the force loop stopped for {elapsed_ns / 1e6:.0f} ms"
        if now_ns - reading.stamp_ns > self._delay_ns + STALE_MS * NS_PER_MS:
            return f"the device's reading is {(now_ns - reading.stamp_ns) / 1e6:.0f} ms old"
        if self._last is not None and moved_mm is None:
            return "the position of the hand jumped"
        if (speed_mm_s := math.hypot(*reading.velocity_mm_s)) > self._max_speed_mm_s:
            return f"the hand moved at {speed_mm_s:.0f} mm/s, faster than {self._max_speed_mm_s:g} mm/s"
        if self._taken_ns is not None and now_ns - self._taken_ns >= self._deadman_ns:
            return f"no fixtures arrived for {self._deadman_ns / 1e6:g} ms"
        return ""

    def _let_go(self, because: str, now_ns: int) -> None:
        if not self.released_because:
            self._released_from, self._released_ns = self._sent, now_ns
        self.released_because = because

    def _gain(self, now_ns: int) -> float:
        return min((now_ns - self._started_ns) / (SOFT_START_MS * NS_PER_MS), 1.0)

    def _elastic_mj(self, reading: HandReading, now_ns: int) -> float:
        """Return the energy that the hand has stored in the fixtures."""
        if self.released_because:
            return 0.0
        return self._gain(now_ns) * self._blend.elastic_mj(reading.position_mm, now_ns)

    def _wanted_n(self, reading: HandReading, elapsed_ns: int, now_ns: int) -> Vec3:
        """Return the force before the tank limits it."""
        if self.released_because:
            left = 1.0 - (now_ns - self._released_ns) / (RELEASE_MS * NS_PER_MS)
            return _scaled(self._released_from, max(left, 0.0))
        force_n = self._blend.force_n(reading.position_mm, reading.velocity_mm_s, now_ns)
        force_n = _shortened(force_n, min(self._max_n, self._blend.limit_n(now_ns)))
        return _risen(self._sent, _scaled(force_n, self._gain(now_ns)), MAX_RISE_N_PER_S * elapsed_ns / 1e9)


def _risen(before_n: Vec3, wanted_n: Vec3, rise_n: float) -> Vec3:
    """Return a force on the way to the wanted one: it decreases at once, and grows by at most so much.

    The part of the force before that points along the wanted one is kept, as far as it is wanted.
    """
    wanted_square = _dot(wanted_n, wanted_n)
    kept = _scaled(
        wanted_n, min(max(_dot(before_n, wanted_n) / wanted_square, 0.0), 1.0) if wanted_square else 0.0
    )
    missing = _difference(wanted_n, kept)
    missing = _shortened(missing, rise_n)
    return kept[0] + missing[0], kept[1] + missing[1], kept[2] + missing[2]


def _is_finite(reading: HandReading) -> bool:
    return all(map(math.isfinite, (*reading.position_mm, *reading.velocity_mm_s)))


def _shortened(force_n: Vec3, most_n: float) -> Vec3:
    """Return a force that is no larger than a limit."""
    size_n = math.hypot(*force_n)
    return force_n if size_n <= most_n else _scaled(force_n, most_n / size_n)


def _difference(a: Vec3, b: Vec3) -> Vec3:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _scaled(a: Vec3, factor: float) -> Vec3:
    return a[0] * factor, a[1] * factor, a[2] * factor


def _dot(a: Vec3, b: Vec3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
