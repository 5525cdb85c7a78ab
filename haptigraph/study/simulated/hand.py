"""The hand of a simulated operator in a force device: intended motion and fixtures -> actual motion.

A force pushes the hand away from where it would be, against its own mass, damping and stiffness. The operator
neither reads the force as a cue nor yields to it: what it changes is what the hand does, and the operator
sees. Runs the renderer of every force device at 1 kHz, on the time of the images.
"""

import math

from haptigraph.geometry import Vec
from haptigraph.haptics.force.fixture import fixtures_of, tip_of, to_hand
from haptigraph.haptics.force.interface import HandReading
from haptigraph.haptics.force.renderer import ForceRenderer
from haptigraph.haptics.force.simulated import ArmImpedance, SimulatedForce, SimulatedHand
from haptigraph.messages import Step
from haptigraph.robot.pose import Vec3
from haptigraph.study.simulated.participant import Participant

__all__ = ["PushedHand"]

PERIOD_NS = 1_000_000


class PushedHand:
    """One operator's hand, in the plane of the section. It holds the clutch all the time.

    Args:
        participant: Whose hand it is.
        motion_scale: Tool motion over hand motion.
    """

    def __init__(self, participant: Participant, motion_scale: float) -> None:
        self._scale = motion_scale
        impedance = ArmImpedance(
            participant.hand_mass_kg,
            participant.hand_damping_n_s_per_mm,
            participant.hand_stiffness_n_per_mm,
        )
        self._pushed = SimulatedHand(impedance=impedance)
        """How far it is from where it would be without force."""
        self._renderer = ForceRenderer(SimulatedForce.capabilities)
        self._force_n: Vec3 = (0.0, 0.0, 0.0)
        self._intended_mm = (0.0, 0.0)
        self._now_ns = 0
        self._sizes_n: list[tuple[int, float]] = []

    def take(self, step: Step) -> None:
        """Take the forces of the newest step, which shows the hand where it is now."""
        tip_mm, at_mm = tip_of(step), (*self._at_mm(), 0.0)
        fixtures = fixtures_of(step) if tip_mm is not None else ()
        placed = [to_hand(fixture, tip_mm or at_mm, at_mm, self._scale) for fixture in fixtures]
        self._renderer.take(placed, self._now_ns, self._now_ns)

    def move(self, moved_mm: Vec, elapsed_s: float) -> Vec:
        """Return the motion of the hand when it intends another [mm], in directions of the eye frame.

        Args:
            moved_mm: The intended motion.
            elapsed_s: Its duration.
        """
        before_mm, end_ns = self._at_mm(), self._now_ns + round(elapsed_s * 1e9)
        while self._now_ns < end_ns:
            period_ns = min(PERIOD_NS, end_ns - self._now_ns)
            share = period_ns / (elapsed_s * 1e9)
            self._advance((moved_mm[0] * share, moved_mm[1] * share), period_ns)
        x_mm, y_mm = self._at_mm()
        return x_mm - before_mm[0], y_mm - before_mm[1]

    def mean_force_n(self, start_ns: int, end_ns: int) -> float:
        """Return the mean size of the force over some time."""
        sizes_n = [size_n for stamp_ns, size_n in self._sizes_n if start_ns <= stamp_ns < end_ns]
        return sum(sizes_n) / len(sizes_n) if sizes_n else 0.0

    def _at_mm(self) -> Vec:
        x_mm, y_mm, _ = self._pushed.position_mm
        return self._intended_mm[0] + x_mm, self._intended_mm[1] + y_mm

    def _advance(self, moved_mm: Vec, period_ns: int) -> None:
        """Move for one exchange with the device."""
        period_s = period_ns / 1e9
        self._intended_mm = self._intended_mm[0] + moved_mm[0], self._intended_mm[1] + moved_mm[1]
        self._pushed.advance(self._force_n, period_s)
        self._now_ns += period_ns
        x_mm_s, y_mm_s, _ = self._pushed.velocity_mm_s
        velocity_mm_s = x_mm_s + moved_mm[0] / period_s, y_mm_s + moved_mm[1] / period_s, 0.0
        reading = HandReading(self._now_ns, (*self._at_mm(), 0.0), velocity_mm_s, engaged=True)
        self._force_n = self._renderer.step(reading, self._now_ns)
        self._sizes_n.append((self._now_ns, math.hypot(*self._force_n)))
