"""Check the operating states of a robot, and how it answered when it was asked to be enabled."""

from collections.abc import Iterator
from itertools import pairwise

from msgspec import Struct

from haptigraph.findings import Finding
from haptigraph.robot.checking.recorded import Recorded
from haptigraph.robot.ros.crtk import STATES

__all__ = ["ENABLE_S", "Enabling", "enabling_findings", "state_findings"]

ENABLE_S = 5.0
"""Time that a robot has to become enabled."""
MAX_CHANGES = 2  # while nobody asks for one


class Enabling(Struct, frozen=True):
    """How the robot answered to `enable`, and to its own pose as a command."""

    enabled_ms: float | None
    """Until it was enabled; None: it was not within `ENABLE_S`."""
    echo_ms: float | None
    """From servo_cp to the same pose on setpoint_cp; None: there was none."""


def state_findings(recorded: Recorded) -> Iterator[Finding]:
    """Yield the problems of operating states while nobody commands the robot."""
    states = [sample.state for sample in recorded.states]
    if not states:
        yield Finding(
            "state_missing",
            "no message came on operating_state; a state on every change, or more often, is valid",
        )
        return
    if unknown := sorted(set(states) - set(STATES)):
        yield Finding(
            "state_unknown", f"operating_state is {', '.join(map(repr, unknown))}; valid: {', '.join(STATES)}"
        )
    changes = sum(one != other for one, other in pairwise(states))
    if changes > MAX_CHANGES:
        yield Finding(
            "state_flapping",
            f"operating_state changed {changes} times without a command; at most {MAX_CHANGES} times is "
            "valid",
        )
    elif states[-1] == "FAULT":
        yield Finding("state_fault", "the robot is in FAULT; DISABLED, PAUSED or ENABLED is valid")
    last = recorded.states[-1]
    if last.state == "ENABLED" and not last.is_homed:
        yield Finding("not_homed", "the robot is ENABLED but not homed; homed is valid: home it first")


def enabling_findings(enabling: Enabling) -> Iterator[Finding]:
    """Yield the problems of the robot's answers."""
    if enabling.enabled_ms is None:
        yield Finding(
            "never_enabled",
            f"the robot was not ENABLED within {ENABLE_S:g} s of the command enable; it must be before it "
            "moves",
        )
