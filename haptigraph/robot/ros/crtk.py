"""A robot with the interface of CRTK (https://crtk-robotics.readthedocs.io), over DDS.

Poses are those of the tool in the frame of `measured_cp`, the robot's base. `servo_cp` sets the position of
the low-level controller, which keeps it when no more commands come: a robot that is not commanded any more
stays where it was commanded last.
"""

import threading
import time
from typing import get_args

from msgspec.structs import replace

from haptigraph.clock import Clock, offset_ns
from haptigraph.errors import BadInput, DeviceError
from haptigraph.robot.interface import Operating, OperatingState, RobotReading, StateCommand
from haptigraph.robot.pose import Vec3
from haptigraph.robot.ros.poses import finite_vector, tool_pose
from haptigraph.robot.ros.robot import DISCOVERY_S, RosRobot
from haptigraph.ros2 import motion_types as types
from haptigraph.ros2.endpoints import sender
from haptigraph.ros2.node import checked_topic
from haptigraph.ros2.types import Header, Time

__all__ = ["STATES", "CrtkRobot", "namespace_of"]

STATES: dict[str, OperatingState] = {state: state for state in get_args(OperatingState)}
FORCE_AGE_NS = 100_000_000  # an older force is not reported


class CrtkRobot(RosRobot):
    """Read `measured_cp`, `measured_cf` and `operating_state`; publish `servo_cp` and `state_command`.

    Opening waits briefly for the robot's node; a robot that comes later is found, too.

    Args:
        argument: The robot's namespace, for example PSM1 or /lab/PSM1.
        clock: The run's.

    Raises:
        BadInput: If the namespace is not valid, or the network cannot be joined.
        MissingExtra: If cyclonedds is not installed.
    """

    def __init__(self, argument: str, clock: Clock) -> None:
        root = namespace_of(argument)
        super().__init__(f"crtk:{argument}", f"{root}/servo_cp", clock)
        self._lock = threading.Lock()
        self._operating: Operating | None = None
        self._force: tuple[Vec3, int] | None = None
        self._state_command = self._node.publisher(f"{root}/state_command", types.StringStamped)
        reject = self._input.reject
        self._node.subscribe(f"{root}/measured_cp", types.PoseStamped, self._take_pose, reject)
        self._node.subscribe(f"{root}/measured_cf", types.WrenchStamped, self._take_force, reject)
        for is_latched in (False, True):  # robots publish it when it changes; some let late nodes receive it
            self._node.subscribe(
                f"{root}/operating_state",
                types.OperatingState,
                self._take_state,
                reject,
                is_latched=is_latched,
            )
        self._node.await_subscribers(DISCOVERY_S)

    def read(self) -> RobotReading:
        """Return the newest measurements."""
        with self._lock:
            operating, force = self._operating, self._force
        is_fresh = force is not None and self._clock.now_ns() - force[1] <= FORCE_AGE_NS
        return replace(
            self._input.read(),
            operating=operating,
            force_n=force[0] if force is not None and is_fresh else None,
        )

    def request(self, command: StateCommand) -> None:
        """Publish a command on `state_command`.

        Raises:
            DeviceError: If it cannot be sent, or nobody receives it.
        """
        stamp = Time.from_ns(self._clock.now_ns() + offset_ns(time.time_ns, self._clock))
        try:
            self._state_command.send(types.StringStamped(Header(stamp, ""), command))
        except OSError as error:
            raise DeviceError(f"{command} cannot be published ({error})") from None
        if not self._state_command.has_subscribers:
            raise DeviceError("nobody subscribes to state_command; the robot's node is not there")

    @property
    def _frame_id(self) -> str:
        return self._input.frame_id

    def _take_pose(self, message: types.PoseStamped) -> None:
        pose = tool_pose(message.pose.position, message.pose.orientation)
        self._input.put(pose, message.header.stamp.ns, message.header.frame_id, sender(message))

    def _take_force(self, message: types.WrenchStamped) -> None:
        force_n = finite_vector(message.wrench.force, "a force")
        if message.header.frame_id != self._input.frame_id:
            raise ValueError(
                f"a force in frame {message.header.frame_id!r}, not {self._input.frame_id!r} of measured_cp"
            )
        with self._lock:
            self._force = force_n, self._clock.now_ns()

    def _take_state(self, message: types.OperatingState) -> None:
        if message.state not in STATES:
            with self._lock:
                self._operating = None
            raise ValueError(f"the operating state {message.state!r}; CRTK's are {', '.join(STATES)}")
        with self._lock:
            self._operating = Operating(STATES[message.state], message.is_homed, message.is_busy)


def namespace_of(argument: str) -> str:
    """Return the ROS name of a robot's namespace, with a slash in front.

    Raises:
        BadInput: If it is not a valid name.
    """
    if not argument.strip("/"):
        raise BadInput("crtk needs the robot's namespace, for example crtk:PSM1")
    return checked_topic(argument.rstrip("/"))
