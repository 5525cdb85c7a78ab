"""From what was recorded of a robot to what is wrong with its interface, and what was not exercised."""

from collections.abc import Iterator

from msgspec import Struct

from haptigraph.findings import Finding
from haptigraph.robot.checking.kinematics import kinematic_findings, kinematic_measurements
from haptigraph.robot.checking.messages import message_findings
from haptigraph.robot.checking.place import place_findings, place_measurements
from haptigraph.robot.checking.recorded import Recorded
from haptigraph.robot.checking.states import Enabling, enabling_findings, state_findings
from haptigraph.robot.checking.timing import MIN_POSES, timing_findings, timing_measurements
from haptigraph.robot.setup import MotionLimits, RobotSetup

__all__ = ["Judgement", "judge"]

UNUSABLE = {"two_publishers", "not_finite", "quaternion_length", "units", "frame_changes"}
"""Findings with which poses cannot be compared with anything."""
NO_COMMANDS = "without --enable: the answer to state_command, the latency of commands"


class Judgement(Struct, frozen=True):
    """The result of a check."""

    findings: tuple[Finding, ...]
    not_exercised: tuple[str, ...]
    measurements: dict[str, float]

    def with_enabling(self, enabling: Enabling) -> "Judgement":
        """Return it with the robot's answers to commands."""
        answers = {"enabled_ms": enabling.enabled_ms, "command_echo_ms": enabling.echo_ms}
        skipped = [sentence for sentence in self.not_exercised if sentence != NO_COMMANDS]
        if enabling.echo_ms is None:
            skipped.append("setpoint_cp did not repeat a command: the latency of commands")
        return Judgement(
            (*self.findings, *enabling_findings(enabling)),
            tuple(skipped),
            self.measurements | {name: value for name, value in answers.items() if value is not None},
        )

    @property
    def passed(self) -> bool:
        """Whether the robot may be steered."""
        return not self.findings


def judge(
    recorded: Recorded, setup: RobotSetup | None = None, presence: tuple[Finding, ...] = ()
) -> Judgement:
    """Judge the interface of a robot.

    Args:
        recorded: While nobody commanded it, and somebody moved it by hand.
        setup: Its robot.toml, if there is one.
        presence: Findings about topics that are absent or of another type.
    """
    findings = [*presence, *_findings(recorded, setup)]
    return Judgement(
        tuple(findings),
        tuple(_not_exercised(recorded, setup)),
        _measurements(recorded, setup, {finding.name for finding in findings}),
    )


def _findings(recorded: Recorded, setup: RobotSetup | None) -> Iterator[Finding]:
    yield from state_findings(recorded)
    if len(recorded.poses) < MIN_POSES:
        yield Finding(
            "pose_missing",
            f"{len(recorded.poses)} poses arrived; at least {MIN_POSES} are needed: is this the robot's "
            "name, and does its node run in this ROS domain?",
        )
        return
    limits = setup.limits if setup is not None else MotionLimits()
    about_messages = list(message_findings(recorded))
    yield from about_messages
    yield from timing_findings(recorded, limits.stale_ms)
    if UNUSABLE & {finding.name for finding in about_messages}:
        return
    yield from kinematic_findings(recorded)
    if setup is not None:
        yield from place_findings(recorded, setup)
    if not len(recorded.twists) and not _is_calibrated(setup):
        yield Finding(
            "axes_unverified",
            "no message came on measured_cv, so axes, handedness and order of the quaternion were not "
            "exercised; publish it, or calibrate the robot to the eye (robot calibrate), which refuses a "
            "left-handed frame by its residuals",
        )


def _not_exercised(recorded: Recorded, setup: RobotSetup | None) -> Iterator[str]:
    if not len(recorded.twists) and _is_calibrated(setup):
        yield "measured_cv is absent: axes were compared by the calibration to the eye only"
    if not len(recorded.joints):
        yield "measured_js is absent: units of joints"
    if setup is None:
        yield "without --setup: remote centre of motion, axis of the shaft, limits of robot.toml"
    yield NO_COMMANDS


def _measurements(recorded: Recorded, setup: RobotSetup | None, found: set[str]) -> dict[str, float]:
    measured: dict[str, float] = {"poses": len(recorded.poses), "velocities": len(recorded.twists)}
    if len(recorded.poses) >= MIN_POSES:
        measured |= timing_measurements(recorded)
        if not UNUSABLE & found:
            measured |= kinematic_measurements(recorded)
            if setup is not None:
                measured |= place_measurements(recorded, setup)
    return measured


def _is_calibrated(setup: RobotSetup | None) -> bool:
    return setup is not None and setup.eye is not None and setup.eye.residual_rms_mm is not None
