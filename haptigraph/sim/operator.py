"""The simulated operator: follows a script of minimum-jerk moves with a trembling hand.

Minimum jerk: Flash and Hogan 1985, J. Neurosci. 5(7). Tremor of 8 to 12 Hz: see docs/conventions.md.
Knows neither images nor touch; what it does is a function of time and seed.
"""

import math
from typing import Annotated

import numpy as np
from msgspec import Meta, Struct

from haptigraph.sim.robot import Pose

__all__ = ["Hand", "Move", "ScriptedOperator"]

SINES = 12


class Hand(Struct, frozen=True, forbid_unknown_fields=True):
    """The [operator] table of a scenario."""

    tremor_rms_mm: Annotated[float, Meta(ge=0, le=10)] = 0.1
    """At the hand, per axis; the robot's motion scale shrinks it."""
    tremor_low_hz: Annotated[float, Meta(ge=0, le=1000)] = 8.0
    tremor_high_hz: Annotated[float, Meta(ge=0, le=1000)] = 12.0


class Move(Struct, frozen=True, forbid_unknown_fields=True):
    """One [[move]] of a scenario: go to a pose in so many seconds; the same pose again is a pause."""

    duration_s: Annotated[float, Meta(le=86_400)]
    depth_mm: Annotated[float, Meta(ge=-100, le=100)]
    theta_deg: Annotated[float, Meta(ge=-180, le=180)]
    """Angle to the line trocar -> target, counter-clockwise."""
    away: bool = False
    """The needle is out of the picture meanwhile."""


class ScriptedOperator:
    """Say where the hand wants the needle at any time.

    Args:
        moves: The script; it starts at the first move's pose.
        hand: How the hand trembles.
        motion_scale: Tool motion over hand motion.
        seed: Of the tremor.
    """

    def __init__(self, moves: tuple[Move, ...], hand: Hand, motion_scale: float, seed: int) -> None:
        self._moves = moves
        self._ends_s = np.cumsum([move.duration_s for move in moves])
        rng = np.random.default_rng((seed, 1))
        self._frequencies_hz = rng.uniform(hand.tremor_low_hz, hand.tremor_high_hz, (2, SINES))
        self._phases = rng.uniform(0, 2 * math.pi, (2, SINES))
        self._amplitude_mm = motion_scale * hand.tremor_rms_mm * math.sqrt(2 / SINES)

    @property
    def duration_s(self) -> float:
        """Length of the script."""
        return float(self._ends_s[-1])

    def pose_at(self, time_s: float) -> tuple[float, float]:
        """Return the wanted (depth_mm, theta_deg) of the script, without tremor."""
        number = self._number_at(time_s)
        move, before = self._moves[number], self._moves[max(number - 1, 0)]
        begun_s = self._ends_s[number] - move.duration_s
        share = min(max((time_s - begun_s) / move.duration_s, 0.0), 1.0) if move.duration_s > 0 else 1.0
        blend = share**3 * (10 - 15 * share + 6 * share**2)
        depth_mm = before.depth_mm + blend * (move.depth_mm - before.depth_mm)
        theta_deg = before.theta_deg + blend * (move.theta_deg - before.theta_deg)
        return float(depth_mm), float(theta_deg)

    def is_away(self, time_s: float) -> bool:
        """Tell whether the needle is out of the picture."""
        return self._moves[self._number_at(time_s)].away

    def tremor_at(self, time_s: float) -> tuple[float, float]:
        """Return the tremor of the tool (along, across) [mm]."""
        waves = np.sin(2 * math.pi * self._frequencies_hz * time_s + self._phases)
        along, across = self._amplitude_mm * waves.sum(axis=1)
        return float(along), float(across)

    def wanted(self, time_s: float, target_pitch_deg: float) -> Pose:
        """Return the pose the trembling hand asks the robot for.

        Args:
            time_s: Time since the script began.
            target_pitch_deg: Pitch at which the shaft points at the target.
        """
        depth_mm, theta_deg = self.pose_at(time_s)
        along_mm, across_mm = self.tremor_at(time_s)
        lever_mm = max(abs(depth_mm), 5.0)
        return Pose(depth_mm + along_mm, target_pitch_deg + theta_deg + math.degrees(across_mm / lever_mm))

    def _number_at(self, time_s: float) -> int:
        return min(int(np.searchsorted(self._ends_s, time_s, side="right")), len(self._moves) - 1)
