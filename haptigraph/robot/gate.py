"""The decision whether a robot may move in one cycle: every condition -> move, or hold with the reasons.

A pure function over a finite space: tests prove it on every combination of conditions. A hold that the
operator did not cause is latched: motion resumes only after the enable switch was released and pressed again.
"""

from msgspec import Struct

__all__ = ["HOLDS", "LATCHED", "NOT_LATCHING", "Conditions", "Decision", "decide"]


class Conditions(Struct, frozen=True):
    """What must hold in a cycle so that the robot may move; each is judged on its own."""

    is_switched_on: bool
    """The operator's enable switch."""
    is_checked: bool
    is_without_fault: bool
    """Nothing of ours has failed."""
    is_on_time: bool
    """The loop."""
    is_leader_heard: bool
    """A message came within the dead-man time."""
    is_engaged: bool
    """The clutch."""
    is_settled: bool
    """It is moving already, or has been held long enough to have come to rest."""
    is_shaft_aligned: bool
    """It does not start now, or the measured shaft is near enough to the RCM to start without a step."""
    is_pose_known: bool
    """A pose was measured, and its numbers are finite."""
    is_pose_fresh: bool
    is_pose_steady: bool
    """The pose did not jump."""
    is_robot_ready: bool
    """ENABLED, homed and not busy."""
    is_force_low: bool
    is_shaft_at_rcm: bool
    """The measured one."""
    is_following: bool
    """The robot is where it was commanded to be."""
    is_command_valid: bool
    """The commanded pose: finite, through the RCM, within the limits."""


HOLDS = {
    "is_switched_on": "the enable switch is off",
    "is_checked": "the interface has not passed robot check",
    "is_without_fault": "a fault of haptigraph",
    "is_on_time": "the loop is late",
    "is_leader_heard": "the leader is silent",
    "is_engaged": "the clutch is released",
    "is_settled": "the robot is coming to rest",
    "is_shaft_aligned": "the shaft is too far beside the RCM to start",
    "is_pose_known": "the robot's pose is unknown",
    "is_pose_fresh": "the robot's pose is stale",
    "is_pose_steady": "the robot's pose jumped",
    "is_robot_ready": "the robot is not enabled, homed and idle",
    "is_force_low": "the force is too high or unknown",
    "is_shaft_at_rcm": "the measured shaft misses the RCM",
    "is_following": "the robot does not follow",
    "is_command_valid": "the commanded pose is outside the limits",
}
"""Reasons to hold, by the condition that does not."""
LATCHED = "motion was interrupted: switch off and on again to resume"
NOT_LATCHING = frozenset({"is_switched_on", "is_engaged", "is_settled", "is_shaft_aligned"})
"""What delays a start, and how the operator stops. A silent leader latches if it was engaged."""


class Decision(Struct, frozen=True):
    """Whether the robot moves in this cycle."""

    reasons: tuple[str, ...]
    """Why it is held, in the order of `HOLDS`; empty if it moves."""
    is_latched: bool
    """Whether it stays held until the switch was released."""

    @property
    def moves(self) -> bool:
        """Whether it moves."""
        return not self.reasons


def decide(conditions: Conditions, is_latched: bool) -> Decision:
    """Decide on one cycle.

    Args:
        conditions: Of this cycle.
        is_latched: Of the decision before; True at the start.
    """
    absent = [name for name in HOLDS if not getattr(conditions, name)]
    reasons = [HOLDS[name] for name in absent]
    if not conditions.is_switched_on:
        return Decision(tuple(reasons), is_latched=False)
    if is_latched:
        reasons.append(LATCHED)
    not_latching = NOT_LATCHING if conditions.is_engaged else NOT_LATCHING | {"is_leader_heard"}
    return Decision(tuple(reasons), is_latched or not not_latching.issuperset(absent))
