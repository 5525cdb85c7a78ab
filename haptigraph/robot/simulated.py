"""The simulated robot: an arm with joint errors and latency, and CRTK's operating states."""

import numpy as np

from haptigraph.clock import Clock
from haptigraph.errors import BadInput
from haptigraph.robot.interface import Operating, OperatingState, RobotReading, StateCommand
from haptigraph.robot.pose import ToolPose, quaternion_of, rotation_of
from haptigraph.robot.rcm import minimal_rotation
from haptigraph.robot.setup import EyePlace, RcmPlace, RobotSetup, load_setup
from haptigraph.sim.robot.arm import Arm, ArmErrors, ArmPose

__all__ = ["EXAMPLE_SETUP", "SimulatedRobot"]

EXAMPLE_SETUP = RobotSetup(
    RcmPlace((157.5, 0.0, 70.4)), eye=EyePlace((150.0, 0.0, 60.0), (0.5**0.5, 0.0, 0.0, 0.5**0.5))
)
"""Where the simulated robot is unless stated; examples/robot.toml is the same."""
START_MM = 10.0  # of the tip before the RCM
HOMING_NS = 500_000_000
ANSWERS: dict[StateCommand, dict[OperatingState, OperatingState]] = {
    "enable": {"DISABLED": "ENABLED"},
    "disable": {"ENABLED": "DISABLED", "PAUSED": "DISABLED", "FAULT": "DISABLED"},
    "pause": {"ENABLED": "PAUSED"},
    "resume": {"PAUSED": "ENABLED"},
}


class SimulatedRobot:
    """A simulated robot whose instrument is in front of the trocar; it starts disabled and not homed.

    Args:
        argument: SEED[?setup=FILE]: the seed of its errors, and a robot.toml with RCM and eye.
        clock: The run's.
        errors: Of its joints, and its delays.

    Raises:
        BadInput: If the argument or the file is not valid.
    """

    def __init__(self, argument: str, clock: Clock, errors: ArmErrors | None = None) -> None:
        seed, setup = _parsed(argument)
        self._clock = clock
        self._state: OperatingState = "DISABLED"
        self._is_homed, self._homing_ns = False, 0
        rcm_mm = np.array(setup.rcm.at_mm)
        centre_mm = rcm_mm - (0, 0, 1) if setup.eye is None else np.array(setup.eye.translation_mm)
        inwards = (centre_mm - rcm_mm) / np.linalg.norm(centre_mm - rcm_mm)
        z_axis = np.array((0.0, 0.0, 1.0))
        self._arm_from_tool = rotation_of(minimal_rotation(np.array(setup.shaft_axis_tool), z_axis))
        self.arm = Arm(
            rcm_mm - START_MM * inwards,
            rotation_of(minimal_rotation(z_axis, inwards)),
            seed,
            errors,
            clock.now_ns(),
        )
        self._number = 0
        self._newest = RobotReading(0, 0)

    def read(self) -> RobotReading:
        """Return the newest measurement that has arrived."""
        now_ns = self._advance()
        while self.arm.arrived:
            received_ns, pose = self.arm.arrived.popleft()
            self._number += 1
            self._newest = RobotReading(
                pose.stamp_ns, received_ns, self._tool_pose(pose), number=self._number
            )
        is_busy = now_ns < self._homing_ns
        self._is_homed |= self._homing_ns > 0 and not is_busy
        operating = Operating(self._state, self._is_homed, is_busy)
        newest = self._newest
        return RobotReading(newest.stamp_ns, newest.received_ns, newest.pose, operating, None, newest.number)

    def move(self, pose: ToolPose, stamp_ns: int) -> None:
        """Command a pose; ignored unless the robot is enabled and homed."""
        now_ns = self._advance()
        if self._state == "ENABLED" and self._is_homed:
            rotation = rotation_of(pose.quaternion) @ self._arm_from_tool.T
            self.arm.command(now_ns, np.array(pose.position_mm), rotation)

    def hold(self, stamp_ns: int) -> None:
        """Command it to stay where it is."""
        self.arm.hold(self._advance())

    def request(self, command: StateCommand) -> None:
        """Change the operating state, if the current one permits it; homing takes half a second."""
        now_ns = self._advance()
        if command == "home" and self._state == "ENABLED":
            self._homing_ns = now_ns + HOMING_NS
        self._state = ANSWERS.get(command, {}).get(self._state, self._state)
        if self._state != "ENABLED":
            self.arm.hold(now_ns)

    def leave(self) -> None:
        """Do nothing: the simulated arm needs no connection."""

    def close(self) -> None:
        """Hold."""
        self.hold(self._clock.now_ns())

    def true_pose(self) -> ToolPose:
        """Return where the tool is, without errors of measurement."""
        return self._tool_pose(self.arm.pose)

    def _advance(self) -> int:
        now_ns = self._clock.now_ns()
        self.arm.advance(now_ns)
        return now_ns

    def _tool_pose(self, pose: ArmPose) -> ToolPose:
        x, y, z = pose.position_mm.tolist()
        return ToolPose((x, y, z), quaternion_of(pose.rotation @ self._arm_from_tool))


def _parsed(argument: str) -> tuple[int, RobotSetup]:
    seed, _, option = argument.partition("?")
    name, _, path = option.partition("=")
    if (
        not (seed or "0").isascii()
        or not (seed or "0").isdigit()
        or (option and (name != "setup" or not path))
    ):
        raise BadInput(f"simulated:{argument} is not a robot; valid: simulated[:SEED][?setup=FILE]")
    return int(seed or "0"), load_setup(path) if path else EXAMPLE_SETUP
