"""A simulated force device in a simulated hand, for tests, rehearsals, and simulated operators.

The hand is a mass that damping and stiffness tie to where its operator wants it to be. The values are those
that van Beek, Bergmann Tiest, Mugge and Kappers (Sci Rep 5:18004, 2015) measured of one arm.
"""

import math

from msgspec import Struct

from haptigraph.clock import Clock
from haptigraph.haptics.force.interface import ForceCapabilities, HandReading
from haptigraph.robot.pose import Vec3

__all__ = ["ARM", "ArmImpedance", "SimulatedForce", "SimulatedHand"]

SUBSTEP_S = 0.0005
NS_PER_S = 1e9
MAX_ADVANCE_S = 0.05  # of one exchange; a program that was stopped does not catch up


class ArmImpedance(Struct, frozen=True):
    """How a hand yields."""

    mass_kg: float = 0.554
    damping_n_s_per_mm: float = 0.00645
    stiffness_n_per_mm: float = 0.135


ARM = ArmImpedance()


class SimulatedHand:
    """A hand that is pushed.

    Args:
        position_mm: Where it is, and wants to be, at first.
        impedance: How it yields.
    """

    def __init__(self, position_mm: Vec3 = (0.0, 0.0, 0.0), impedance: ArmImpedance = ARM) -> None:
        self._impedance = impedance
        self.position_mm, self.velocity_mm_s = position_mm, (0.0, 0.0, 0.0)
        self.intended_mm = position_mm
        """Where the operator wants it to be."""

    def advance(self, force_n: Vec3, elapsed_s: float) -> None:
        """Let a constant force act for a time."""
        steps = max(math.ceil(elapsed_s / SUBSTEP_S - 1e-9), 1)
        axes = zip(self.position_mm, self.velocity_mm_s, force_n, self.intended_mm, strict=True)
        moved = [self._moved(*axis, elapsed_s / steps, steps) for axis in axes]
        (x, vx), (y, vy), (z, vz) = moved
        self.position_mm, self.velocity_mm_s = (x, y, z), (vx, vy, vz)

    def _moved(
        self, at_mm: float, speed_mm_s: float, force_n: float, wanted_mm: float, step_s: float, steps: int
    ) -> tuple[float, float]:
        """Return position and speed along one axis. Damping is implicit, so stable for any mass."""
        arm, per_mass = self._impedance, 1000.0 * step_s / self._impedance.mass_kg
        slowed = 1.0 / (1.0 + per_mass * arm.damping_n_s_per_mm)
        for _ in range(steps):
            pull_n = force_n + arm.stiffness_n_per_mm * (wanted_mm - at_mm)
            speed_mm_s = (speed_mm_s + per_mass * pull_n) * slowed
            at_mm += step_s * speed_mm_s
        return at_mm, speed_mm_s


class SimulatedForce:
    """A force device that nothing is connected to.

    Args:
        argument: None is known; must be empty.
        clock: The loop's; the hand moves with its time.
        hand: What it pushes; at rest if None.
    """

    capabilities = ForceCapabilities(
        max_force_n=5.0,
        rate_hz=1000.0,
        max_speed_mm_s=250.0,
        limitations="Nobody feels it: a simulated arm yields to it.",
    )

    def __init__(self, argument: str, clock: Clock, hand: SimulatedHand | None = None) -> None:
        self._clock = clock
        self.hand = hand or SimulatedHand()
        """Its `intended_mm` may be set at any time."""
        self.is_engaged = True
        """Whether the operator holds the clutch."""
        self._force_n = (0.0, 0.0, 0.0)
        self._last_ns = clock.now_ns()

    def exchange(self, force_n: Vec3) -> HandReading:
        """Push the hand with this force until the next call, and return where it is."""
        now_ns = self._clock.now_ns()
        elapsed_s = min((now_ns - self._last_ns) / NS_PER_S, MAX_ADVANCE_S)
        if elapsed_s > 0:
            self.hand.advance(self._force_n, elapsed_s)
        self._last_ns, self._force_n = now_ns, force_n
        return HandReading(now_ns, self.hand.position_mm, self.hand.velocity_mm_s, self.is_engaged)

    def close(self) -> None:
        """Let go."""
        self._force_n = (0.0, 0.0, 0.0)
