"""A simulated robot arm in three dimensions: commanded poses -> true and measured poses, after its latency.

Three linear stages carry a wrist of two rotations and one about the shaft, as cooperatively controlled arms
for eye surgery do (Uneri et al. 2010, BioRob: "New steady-hand eye robot"). It has no mechanical remote
centre: whether its shaft passes through the trocar depends on what it is commanded, and on its errors.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["STEP_NS", "Arm", "ArmErrors", "ArmPose"]

Floats = NDArray[np.float64]
STEP_NS = 5_000_000
TOOL_MM = 60.0  # from the wrist's centre to the tip
SERVO_S = 0.01  # time constant of the joints
WANDER_S = 0.2  # correlation time of the joints' errors
REACH = np.array([80.0, 80.0, 80.0, 70.0, 70.0, 170.0])  # mm, and degrees, to either side
SPEED = np.array([50.0, 50.0, 50.0, 90.0, 90.0, 90.0])  # mm/s, and deg/s


class ArmErrors(NamedTuple):
    """Errors of the joints, and delays."""

    rotation_deg: float = 0.02
    """SD of each rotary joint's position, and again of its encoder."""
    stage_mm: float = 0.005
    """The same of each linear stage."""
    latency_low_ms: float = 15.0
    """Of a command until it acts, and of a measurement until it arrives: uniform between two bounds."""
    latency_high_ms: float = 25.0


class ArmPose(NamedTuple):
    """A pose of the tool in the base."""

    stamp_ns: int
    position_mm: Floats
    """The tip, (3,)."""
    rotation: Floats
    """From the tool's frame, whose z runs along the shaft, to the base, (3, 3)."""


class Arm:
    """An arm that follows commanded poses.

    Args:
        tip_mm: Where its tip starts, base, (3,).
        mount: Orientation of its base plate: its z is the shaft's direction with all rotations at 0, (3, 3).
        seed: Of errors and delays.
        errors: Their size.
        start_ns: Time at which it starts.
    """

    def __init__(
        self, tip_mm: Floats, mount: Floats, seed: int, errors: ArmErrors | None = None, start_ns: int = 0
    ) -> None:
        self.errors = errors or ArmErrors()
        self._mount, self._rng = mount, np.random.default_rng((seed, 3))
        self._centre_mm = np.zeros(3)  # of the stages' range
        self._centre_mm = self._joints(tip_mm, mount)[:3]
        self._sd = np.array(3 * [self.errors.stage_mm] + 3 * [self.errors.rotation_deg])
        self._error = self._sd * self._rng.standard_normal(6)
        self._servo = self._target = np.zeros(6)
        self._now_ns = start_ns
        self._due: deque[tuple[int, Floats | None]] = deque()
        self._arriving: deque[tuple[int, ArmPose]] = deque()
        self.arrived: deque[tuple[int, ArmPose]] = deque(maxlen=100)
        """Measurements that have arrived, with the time of their arrival."""

    @property
    def pose(self) -> ArmPose:
        """The true pose."""
        return self._pose_of(self._servo + self._error)

    @property
    def joints(self) -> Floats:
        """Joints without their errors: stages [mm] from the middle of their range, rotations [deg]."""
        return self._servo

    def command(self, now_ns: int, position_mm: Floats, rotation: Floats) -> None:
        """Command a pose; the arm goes there after its latency, within its limits."""
        joints = self._joints(position_mm, rotation)
        self._queue(now_ns, np.clip(joints, -REACH, REACH))

    def hold(self, now_ns: int) -> None:
        """Command it to stay where it will be."""
        self._queue(now_ns, None)

    def advance(self, now_ns: int) -> None:
        """Let time pass, in whole steps."""
        while self._now_ns + STEP_NS <= now_ns:
            self._now_ns += STEP_NS
            self._step()
        while self._arriving and self._arriving[0][0] <= now_ns:
            self.arrived.append(self._arriving.popleft())

    def _step(self) -> None:
        while self._due and self._due[0][0] <= self._now_ns:
            joints = self._due.popleft()[1]
            self._target = self._servo if joints is None else joints
        step_s = STEP_NS / 1e9
        change = (self._target - self._servo) * (1 - math.exp(-step_s / SERVO_S))
        self._servo = self._servo + np.clip(change, -SPEED * step_s, SPEED * step_s)
        keep = math.exp(-step_s / WANDER_S)
        drawn = self._sd * self._rng.standard_normal((2, 6))
        self._error = keep * self._error + math.sqrt(1 - keep * keep) * drawn[0]
        measured = self._pose_of(self._servo + self._error + drawn[1])
        self._arriving.append((self._later(self._now_ns, self._arriving), measured))

    def _queue(self, now_ns: int, joints: Floats | None) -> None:
        self._due.append((self._later(now_ns, self._due), joints))

    def _later(
        self, now_ns: int, queue: "deque[tuple[int, ArmPose]] | deque[tuple[int, Floats | None]]"
    ) -> int:
        """Return when something sent now arrives: never before what was sent earlier."""
        latency_ms = self._rng.uniform(self.errors.latency_low_ms, self.errors.latency_high_ms)
        due_ns = now_ns + round(latency_ms * 1e6)
        return max(due_ns, queue[-1][0]) if queue else due_ns

    def _pose_of(self, joints: Floats) -> ArmPose:
        a, b, c = np.radians(joints[3:]).tolist()
        rotation = self._mount @ _wrist(a, b, c)
        stage_mm = self._mount @ (joints[:3] + self._centre_mm)
        return ArmPose(self._now_ns, stage_mm + TOOL_MM * rotation[:, 2], rotation)

    def _joints(self, position_mm: Floats, rotation: Floats) -> Floats:
        """Return the joints of a pose: stages [mm] from the middle of their range, and rotations [deg]."""
        r = self._mount.T @ rotation
        stage_mm = self._mount.T @ position_mm - TOOL_MM * r[:, 2] - self._centre_mm
        angles = (
            math.atan2(-r[1, 2], r[2, 2]),
            math.asin(min(max(r[0, 2], -1.0), 1.0)),
            math.atan2(-r[0, 1], r[0, 0]),
        )
        return np.concatenate([stage_mm, np.degrees(angles)])


def _wrist(a: float, b: float, c: float) -> Floats:
    """Return the rotation about x by a, of that about y by b, of that about z by c [rad], (3, 3)."""
    sa, ca, sb, cb, sc, cc = *_sine_cosine(a), *_sine_cosine(b), *_sine_cosine(c)
    return np.array(
        [
            [cb * cc, -cb * sc, sb],
            [ca * sc + sa * sb * cc, ca * cc - sa * sb * sc, -sa * cb],
            [sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb],
        ]
    )


def _sine_cosine(angle_rad: float) -> tuple[float, float]:
    return math.sin(angle_rad), math.cos(angle_rad)
