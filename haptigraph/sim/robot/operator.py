"""Who moves the robot; and the simulated operator: a script of minimum-jerk moves with a trembling hand.

Minimum jerk: Flash and Hogan 1985, J. Neurosci. 5(7). Tremor of 8 to 12 Hz: see docs/conventions.md.
Knows neither images nor touch; what the script does is a function of time and seed.
"""

import math
from typing import Annotated, NamedTuple, Protocol

import numpy as np
from msgspec import Meta, Struct

from haptigraph.sim.robot.robot import JAWS_MOST_MM, Pose, Robot

__all__ = ["Hand", "LightPipe", "Move", "Operator", "ScriptedOperator", "Tremor"]

SINES = 12
MOTION_STEPS = 4  # a scripted robot moves in finer steps than the camera sees


class Operator(Protocol):
    """Whoever moves the robot: a script, or a hand."""

    @property
    def duration_s(self) -> float:
        """How long it goes on; infinity: as long as it is asked."""
        ...

    def move(self, robot: Robot, time_s: float, elapsed_s: float) -> None:
        """Move the robot through the time of one image: the `elapsed_s` before `time_s`."""
        ...

    def is_away(self, time_s: float) -> bool:
        """Tell whether the needle is out of the picture."""
        ...


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
    jaws_mm: Annotated[float, Meta(ge=0, le=JAWS_MOST_MM)] = 0.0
    """Of forceps: between the tips of their jaws."""
    pipe_depth_mm: Annotated[float, Meta(ge=-100, le=24)] = -20.0
    """Of the other hand's light pipe: from its trocar to its tip."""
    pipe_deg: Annotated[float, Meta(ge=-90, le=90)] = 0.0
    """Its pitch, from the line trocar -> globe centre, counter-clockwise."""
    phase: str = ""
    """The phase of the operation that the operator names; empty: as before."""


class LightPipe(NamedTuple):
    """Where the other hand holds the light pipe; units and zeros as in `Move`."""

    pipe_depth_mm: float
    pipe_deg: float


class Tremor:
    """Band-limited noise in two directions.

    Args:
        rms_mm: Its strength in each of them.
        low_hz: The band's lower end.
        high_hz: And its upper.
        seed: Of the noise.
    """

    def __init__(self, rms_mm: float, low_hz: float, high_hz: float, seed: int) -> None:
        rng = np.random.default_rng((seed, 1))
        self._frequencies_hz = rng.uniform(low_hz, high_hz, (2, SINES))
        self._phases = rng.uniform(0, 2 * math.pi, (2, SINES))
        self._amplitude_mm = rms_mm * math.sqrt(2 / SINES)

    def at(self, time_s: float) -> tuple[float, float]:
        """Return where it is (along, across) [mm]."""
        waves = np.sin(2 * math.pi * self._frequencies_hz * time_s + self._phases)
        along, across = self._amplitude_mm * waves.sum(axis=1)
        return float(along), float(across)


class ScriptedOperator:
    """Say where the hand wants the needle at any time.

    Args:
        moves: The script; it starts at the first move's pose.
        hand: How the hand trembles.
        motion_scale: Tool motion over hand motion.
        seed: Of the tremor.
        target_pitch_deg: Pitch at which the shaft points at the target.
    """

    def __init__(
        self, moves: tuple[Move, ...], hand: Hand, motion_scale: float, seed: int, target_pitch_deg: float
    ) -> None:
        self._moves, self._target_pitch_deg = moves, target_pitch_deg
        self._ends_s = np.cumsum([move.duration_s for move in moves])
        rms_mm = motion_scale * hand.tremor_rms_mm
        self._tremor = Tremor(rms_mm, hand.tremor_low_hz, hand.tremor_high_hz, seed)

    @property
    def duration_s(self) -> float:
        """Length of the script."""
        return float(self._ends_s[-1])

    def pose_at(self, time_s: float) -> tuple[float, float]:
        """Return the wanted (depth_mm, theta_deg) of the script, without tremor."""
        depth_mm, theta_deg = self._between(time_s, "depth_mm", "theta_deg")
        return depth_mm, theta_deg

    def pipe_at(self, time_s: float) -> LightPipe:
        """Return where the light pipe is held."""
        return LightPipe(*self._between(time_s, *LightPipe._fields))

    def phase_at(self, time_s: float) -> str:
        """Return the phase that the operator named last."""
        named = [move.phase for move in self._moves[: self._number_at(time_s) + 1] if move.phase]
        return named[-1] if named else ""

    def _between(self, time_s: float, *names: str) -> list[float]:
        """Return some numbers of the moves, on the way from the one before to the one that is being made."""
        number = self._number_at(time_s)
        move, before = self._moves[number], self._moves[max(number - 1, 0)]
        begun_s = self._ends_s[number] - move.duration_s
        share = min(max((time_s - begun_s) / move.duration_s, 0.0), 1.0) if move.duration_s > 0 else 1.0
        blend = share**3 * (10 - 15 * share + 6 * share**2)
        ways = ((getattr(before, name), getattr(move, name)) for name in names)
        return [float(start + blend * (end - start)) for start, end in ways]

    def is_away(self, time_s: float) -> bool:
        """Tell whether the needle is out of the picture."""
        return self._moves[self._number_at(time_s)].away

    def tremor_at(self, time_s: float) -> tuple[float, float]:
        """Return the tremor of the tool (along, across) [mm]."""
        return self._tremor.at(time_s)

    def move(self, robot: Robot, time_s: float, elapsed_s: float) -> None:
        """Let the robot follow the script through the `elapsed_s` before `time_s`."""
        step_s = elapsed_s / MOTION_STEPS
        for step in range(MOTION_STEPS):
            robot.follow(self.wanted(time_s - (MOTION_STEPS - 1 - step) * step_s), step_s)

    def wanted(self, time_s: float) -> Pose:
        """Return the pose the trembling hand asks the robot for, so long after the script began."""
        depth_mm, theta_deg, jaws_mm = self._between(time_s, "depth_mm", "theta_deg", "jaws_mm")
        along_mm, across_mm = self.tremor_at(time_s)
        lever_mm = max(abs(depth_mm), 5.0)
        pitch_deg = self._target_pitch_deg + theta_deg + math.degrees(across_mm / lever_mm)
        return Pose(depth_mm + along_mm, pitch_deg, jaws_mm)

    def _number_at(self, time_s: float) -> int:
        return min(int(np.searchsorted(self._ends_s, time_s, side="right")), len(self._moves) - 1)
