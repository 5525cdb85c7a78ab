"""The operator of the robot, and a simulated one: scripted minimum-jerk moves with hand tremor.

Minimum jerk: Flash and Hogan 1985, J. Neurosci. 5(7). Tremor of 8 to 12 Hz: docs/reference/conventions.md.
"""

import math
from collections.abc import Iterator
from itertools import count
from typing import Annotated, NamedTuple, Protocol

import numpy as np
from msgspec import Meta, Struct

from haptigraph.geometry import Vec
from haptigraph.sim.robot.robot import JAWS_MAX_MM, Pose, Robot

__all__ = ["Hand", "LightPipe", "Move", "Operator", "ScriptedOperator", "Tremor"]

SINES = 12
IMAGES_AT_ONCE = 32
MOTION_STEPS = 4  # of a scripted robot between two images


class Operator(Protocol):
    """Moves the robot: a script or a person."""

    @property
    def duration_s(self) -> float:
        """Duration of the operation; infinity if it has no end."""
        ...

    def move(self, robot: Robot, time_s: float, elapsed_s: float) -> None:
        """Move the robot during the `elapsed_s` before `time_s`, the interval between two images."""
        ...

    def is_away(self, time_s: float) -> bool:
        """Return whether the needle is out of view."""
        ...


class Hand(Struct, frozen=True, forbid_unknown_fields=True):
    """The [operator] table of a scenario."""

    tremor_rms_mm: Annotated[float, Meta(ge=0, le=10)] = 0.1
    """At the hand, per axis; the robot's motion scale reduces it."""
    tremor_low_hz: Annotated[float, Meta(ge=0, le=1000)] = 8.0
    tremor_high_hz: Annotated[float, Meta(ge=0, le=1000)] = 12.0


class Move(Struct, frozen=True, forbid_unknown_fields=True):
    """One [[move]] of a scenario: reach a pose within a duration; repeating a pose is a pause."""

    duration_s: Annotated[float, Meta(le=86_400)]
    depth_mm: Annotated[float, Meta(ge=-100, le=100)]
    theta_deg: Annotated[float, Meta(ge=-180, le=180)]
    """Angle to the line trocar -> target, counter-clockwise."""
    away: bool = False
    """Whether the needle is out of view during the move."""
    jaws_mm: Annotated[float, Meta(ge=0, le=JAWS_MAX_MM)] = 0.0
    """Distance between the tips of the jaws, for forceps."""
    pipe_depth_mm: Annotated[float, Meta(ge=-100, le=24)] = -20.0
    """Light pipe in the other hand: from its trocar to its tip."""
    pipe_deg: Annotated[float, Meta(ge=-90, le=90)] = 0.0
    """Its pitch, from the line trocar -> globe centre, counter-clockwise."""
    phase: str = ""
    """Phase of the operation that the operator names; empty: unchanged."""


class LightPipe(NamedTuple):
    """Pose of the light pipe in the other hand; units and zeros as in `Move`."""

    pipe_depth_mm: float
    pipe_deg: float


class Tremor:
    """Band-limited noise in two directions.

    Args:
        rms_mm: RMS amplitude in each direction.
        low_hz: Lower end of the band.
        high_hz: Upper end of the band.
        seed: Seed of the noise.
    """

    def __init__(self, rms_mm: float, low_hz: float, high_hz: float, seed: int) -> None:
        rng = np.random.default_rng((seed, 1))
        self._rad_s = 2 * math.pi * rng.uniform(low_hz, high_hz, (2, SINES))
        self._phases = rng.uniform(0, 2 * math.pi, (2, SINES))
        self._amplitude_mm = rms_mm * math.sqrt(2 / SINES)

    def at(self, time_s: float) -> tuple[float, float]:
        """Return the displacement (along, across) [mm]."""
        waves = np.sin(self._rad_s * time_s + self._phases)
        along, across = self._amplitude_mm * waves.sum(axis=1)
        return float(along), float(across)

    def at_images(self, rate_hz: float) -> Iterator[Vec]:
        """Yield what `at` returns at one image after another, computed many at once."""
        for first in count(0, IMAGES_AT_ONCE):
            times_s = np.arange(first, first + IMAGES_AT_ONCE) / rate_hz
            waves = np.sin(self._rad_s * times_s[:, None, None] + self._phases)
            yield from map(tuple, (self._amplitude_mm * waves.sum(axis=2)).tolist())


class ScriptedOperator:
    """Follow a script of moves with hand tremor.

    Args:
        moves: The script; it starts at the first move's pose.
        hand: Tremor of the hand.
        motion_scale: Tool motion over hand motion.
        seed: Seed of the tremor.
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
        """Return the scripted (depth_mm, theta_deg), without tremor."""
        depth_mm, theta_deg = self._interpolate(time_s, "depth_mm", "theta_deg")
        return depth_mm, theta_deg

    def pipe_at(self, time_s: float) -> LightPipe:
        """Return the pose of the light pipe."""
        return LightPipe(*self._interpolate(time_s, *LightPipe._fields))

    def phase_at(self, time_s: float) -> str:
        """Return the phase that was named last."""
        named = [move.phase for move in self._moves[: self._index_at(time_s) + 1] if move.phase]
        return named[-1] if named else ""

    def _interpolate(self, time_s: float, *names: str) -> list[float]:
        """Interpolate fields of `Move` between the previous and the current move."""
        number = self._index_at(time_s)
        move, before = self._moves[number], self._moves[max(number - 1, 0)]
        begun_s = self._ends_s[number] - move.duration_s
        share = min(max((time_s - begun_s) / move.duration_s, 0.0), 1.0) if move.duration_s > 0 else 1.0
        blend = share**3 * (10 - 15 * share + 6 * share**2)
        changes = ((getattr(before, name), getattr(move, name)) for name in names)
        return [float(start + blend * (end - start)) for start, end in changes]

    def is_away(self, time_s: float) -> bool:
        """Return whether the needle is out of view."""
        return self._moves[self._index_at(time_s)].away

    def tremor_at(self, time_s: float) -> tuple[float, float]:
        """Return the tremor of the tool (along, across) [mm]."""
        return self._tremor.at(time_s)

    def move(self, robot: Robot, time_s: float, elapsed_s: float) -> None:
        """Let the robot follow the script during the `elapsed_s` before `time_s`."""
        step_s = elapsed_s / MOTION_STEPS
        for step in range(MOTION_STEPS):
            robot.follow(self.commanded(time_s - (MOTION_STEPS - 1 - step) * step_s), step_s)

    def commanded(self, time_s: float) -> Pose:
        """Return the pose that the hand commands, with tremor, at a time since the start of the script."""
        depth_mm, theta_deg, jaws_mm = self._interpolate(time_s, "depth_mm", "theta_deg", "jaws_mm")
        along_mm, across_mm = self.tremor_at(time_s)
        lever_mm = max(abs(depth_mm), 5.0)
        pitch_deg = self._target_pitch_deg + theta_deg + math.degrees(across_mm / lever_mm)
        return Pose(depth_mm + along_mm, pitch_deg, jaws_mm)

    def _index_at(self, time_s: float) -> int:
        return min(int(np.searchsorted(self._ends_s, time_s, side="right")), len(self._moves) - 1)
