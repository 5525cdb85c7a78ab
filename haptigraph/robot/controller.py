"""One deterministic cycle of a robot's loop: a reading and the hand's motion -> move to a pose, or hold.

It has no clock and no I/O; `process` runs it in real time, tests on a virtual clock.
"""

import math
from collections.abc import Sequence
from typing import TypeAlias

from msgspec import Struct

from haptigraph.messages import HandState
from haptigraph.robot.follower import Follower
from haptigraph.robot.gate import Conditions, decide
from haptigraph.robot.interface import RobotReading
from haptigraph.robot.limits import CommandCheck
from haptigraph.robot.pose import ToolPose, angle_deg
from haptigraph.robot.setup import RobotSetup
from haptigraph.teleop.mapping import HandMapping
from haptigraph.teleop.motion import HandMotion, TeleopSettings

__all__ = ["LATE_MS", "RATE_HZ", "SETTLE_MS", "SPREAD_S", "Controller", "Hold", "Move"]

RATE_HZ = 200.0
SPREAD_S = 0.04
"""Longest time between two messages of a hand over which its motion is spread; after it nothing moves."""
LATE_MS = 50.0
"""A cycle that comes so long after the one before holds the robot."""
SETTLE_MS = 100.0
"""After a hold, until the robot rests and its measured pose is where it is."""
START = 0.5
"""Share of the RCM's tolerance within which the measured shaft must be to start; the rest is for errors."""
LAG_S = 0.1
"""Delay with which a robot may follow; together with the limits of speed, and these: how far it may lag."""
LAG_MM, LAG_DEG = 1.0, 2.0
JUMP = 3.0
"""Times the limits of speed, plus these: a change between two measured poses is a jump."""
JUMP_MM, JUMP_DEG = 0.5, 1.0


class Move(Struct, frozen=True):
    """Command a pose."""

    pose: ToolPose


class Hold(Struct, frozen=True):
    """Command the robot to stay where it is."""

    reasons: tuple[str, ...]


Action: TypeAlias = Move | Hold


class Controller:
    """The loop's decisions, cycle by cycle.

    Args:
        setup: Where RCM and eye are, and the limits.
        settings: How the hand's motion becomes the tool's; added tremor is ignored.
        is_checked: Whether the robot's interface has passed its check.

    Raises:
        BadInput: If the setup does not say where the eye is.
    """

    def __init__(
        self, setup: RobotSetup, settings: TeleopSettings | None = None, *, is_checked: bool
    ) -> None:
        self._limits, self._is_checked = setup.limits, is_checked
        self._follower = Follower(setup)
        self._rcm = self._follower.rcm
        self._check = CommandCheck(self._rcm, setup.limits, self._follower.inwards)
        self._mapping = HandMapping(RATE_HZ, settings, spread_s=SPREAD_S)
        self._is_latched = True
        self._commanded: ToolPose | None = None
        self._measured: RobotReading | None = None
        self._cycle_ns: int | None = None
        self._heard_ns = self._moved_ns = -(10**18)

    @property
    def settings(self) -> TeleopSettings:
        """How the hand's motion becomes the tool's."""
        return self._mapping.settings

    @settings.setter
    def settings(self, settings: TeleopSettings) -> None:
        self._mapping.settings = settings

    @property
    def hand(self) -> HandState:
        """The state of the hand in the last cycle."""
        return self._mapping.hand

    def step(
        self,
        now_ns: int,
        reading: RobotReading,
        hands: Sequence[HandMotion] = (),
        *,
        is_switched_on: bool,
        fault: str = "",
    ) -> Action:
        """Decide on one cycle.

        Args:
            now_ns: The run's time; never decreases.
            reading: The newest of the robot.
            hands: The hand's messages since the cycle before.
            is_switched_on: The enable switch.
            fault: A failure of ours; empty: none.
        """
        waited_s = 1 / RATE_HZ if self._cycle_ns is None else (now_ns - self._cycle_ns) / 1e9
        elapsed_s = min(waited_s, 2 / RATE_HZ)
        self._cycle_ns = now_ns
        for hand in hands:
            self._mapping.put(hand)
            self._heard_ns = now_ns
        motion = self._mapping.take(elapsed_s)
        pose = reading.pose if reading.pose is not None and reading.pose.is_finite else None
        judged = self._judged(now_ns, reading, pose, is_starting=motion is not None)
        before, after = self._commanded, None
        if motion is not None and pose is not None and judged["is_shaft_aligned"]:
            if before is None:
                self._follower.start(pose)
                before = pose
            after = self._follower.next(before, motion, elapsed_s)
        conditions = Conditions(
            is_switched_on=is_switched_on,
            is_checked=self._is_checked,
            is_without_fault=not fault,
            is_on_time=waited_s <= LATE_MS / 1e3,
            is_leader_heard=now_ns - self._heard_ns <= self._limits.deadman_ms * 1e6,
            is_engaged=motion is not None,
            is_settled=self._commanded is not None or now_ns - self._moved_ns >= SETTLE_MS * 1e6,
            is_command_valid=after is None or before is None or self._check.allows(before, after, elapsed_s),
            **judged,
        )
        decision = decide(conditions, self._is_latched)
        self._is_latched = decision.is_latched
        if not decision.moves or after is None:
            self._commanded = None
            self._mapping.discard()
            return Hold(decision.reasons)
        self._commanded, self._moved_ns = after, now_ns
        return Move(after)

    def _judged(
        self, now_ns: int, reading: RobotReading, pose: ToolPose | None, *, is_starting: bool
    ) -> dict[str, bool]:
        """Return the conditions on what the robot measures; without a pose, only that is absent."""
        limits, operating = self._limits, reading.operating
        miss_mm = 0.0 if pose is None else self._rcm.distance_mm(pose)
        is_ready = operating is not None and operating.state == "ENABLED"
        steady = self._is_steady(reading)
        return {
            "is_pose_known": pose is not None,
            "is_pose_fresh": abs(now_ns - reading.stamp_ns) <= limits.stale_ms * 1e6,
            "is_pose_steady": steady,
            "is_robot_ready": is_ready and operating.is_homed and not operating.is_busy,  # type: ignore[union-attr]
            "is_force_low": limits.force_n is None or _norm(reading.force_n) <= limits.force_n,
            "is_shaft_at_rcm": miss_mm <= limits.measured_rcm_tolerance_mm,
            "is_shaft_aligned": not is_starting
            or self._commanded is not None
            or miss_mm <= START * limits.rcm_tolerance_mm,
            "is_following": pose is None or self._is_following(pose),
        }

    def _is_following(self, pose: ToolPose) -> bool:
        limits, commanded = self._limits, self._commanded
        return commanded is None or _is_near(
            commanded, pose, LAG_MM + LAG_S * limits.speed_mm_s, LAG_DEG + LAG_S * limits.turn_deg_s
        )

    def _is_steady(self, reading: RobotReading) -> bool:
        """Return whether the measured pose is one that the robot can have reached since the one before."""
        before, limits = self._measured, self._limits
        if reading.pose is None or not reading.pose.is_finite:
            return True
        if before is not None and reading.number == before.number:
            return True
        self._measured = reading
        if before is None or before.pose is None:
            return True
        elapsed_s = min(max(reading.stamp_ns - before.stamp_ns, 0) / 1e9, LAG_S)
        most_mm = JUMP_MM + JUMP * limits.speed_mm_s * elapsed_s
        most_deg = JUMP_DEG + JUMP * limits.turn_deg_s * elapsed_s
        return _is_near(before.pose, reading.pose, most_mm, most_deg)


def _is_near(one: ToolPose, other: ToolPose, most_mm: float, most_deg: float) -> bool:
    return math.dist(one.position_mm, other.position_mm) <= most_mm and angle_deg(one, other) <= most_deg


def _norm(force_n: Sequence[float] | None) -> float:
    """Return the magnitude of a force; infinity if it is unknown or not finite."""
    magnitude = math.inf if force_n is None else math.hypot(*force_n)
    return magnitude if math.isfinite(magnitude) else math.inf
