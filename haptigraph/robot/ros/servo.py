"""A robot that MoveIt Servo moves (ROS 2 Jazzy or later): pose targets, its status, the tool's pose from tf.

Servo stops by itself when commands stop for its `incoming_command_timeout`, and at singularities, collisions
and bounds of joints. Its user starts it; its services are called to set it to pose commands, and to pause it.
"""

from urllib.parse import parse_qs

from msgspec.structs import replace

from haptigraph.clock import Clock
from haptigraph.errors import BadInput, unknown_name
from haptigraph.robot.interface import Operating, OperatingState, RobotReading, StateCommand
from haptigraph.robot.ros.robot import DISCOVERY_S, RosRobot
from haptigraph.robot.ros.transforms import FramePose, TransformTree
from haptigraph.ros2.endpoints import sender
from haptigraph.ros2.geometry_types import TFMessage
from haptigraph.ros2.motion_types import (
    ServoCommandTypeReply,
    ServoCommandTypeRequest,
    ServoStatus,
    SetBoolReply,
    SetBoolRequest,
)
from haptigraph.ros2.node import checked_topic
from haptigraph.ros2.services import Service, ServiceCalls

__all__ = ["STATES", "ServoRobot", "servo_frames"]

FRAMES = {"base": "base_link", "tool": "tool0"}
STATUS_AGE_NS = 300_000_000  # Servo publishes its status in every cycle, 30 to 100 times a second
STATES: dict[int, OperatingState] = {
    -1: "FAULT",  # invalid: no robot state, or a command that cannot be used
    0: "ENABLED",
    1: "ENABLED",  # decelerates near a singularity
    2: "PAUSED",  # halts at a singularity
    3: "ENABLED",
    4: "ENABLED",  # decelerates before a collision
    5: "PAUSED",  # halts before a collision
    6: "PAUSED",  # halts at a joint's bound
}


POSE = 2
"""The command type of pose targets."""
SWITCH = Service(ServoCommandTypeRequest, ServoCommandTypeReply)
PAUSE = Service(SetBoolRequest, SetBoolReply)
PAUSES: dict[StateCommand, bool] = {"enable": False, "resume": False, "pause": True, "disable": True}


class ServoRobot(RosRobot):
    """Read NODE/status and tf; publish NODE/pose_target_cmds; call Servo's services.

    Args:
        argument: Servo's node and the frames: NODE?base=FRAME&tool=FRAME; base_link and tool0 if not stated.
        clock: The run's.

    Raises:
        BadInput: If the argument is not valid, or the network cannot be joined.
        MissingExtra: If cyclonedds is not installed.
    """

    def __init__(self, argument: str, clock: Clock) -> None:
        node_name, self._base, self._tool = servo_frames(argument)
        super().__init__(f"servo:{argument}", f"{node_name}/pose_target_cmds", clock)
        self._tree = TransformTree()
        self._status: tuple[int, int] | None = None
        self._found: FramePose | None = None
        reject, self._name = self._input.reject, node_name
        self._node.subscribe("/tf", TFMessage, self._take_tf, reject)
        self._node.subscribe("/tf_static", TFMessage, self._take_static, reject)
        self._node.subscribe(f"{node_name}/status", ServoStatus, self._take_status, reject)
        self._calls = ServiceCalls(self._node, lambda problem: self._input.report(problem, problem))
        self._node.await_subscribers(DISCOVERY_S)

    def read(self) -> RobotReading:
        """Return the newest measurements; without a fresh status, Servo is taken for disabled."""
        return replace(self._input.read(), operating=self._operating())

    def request(self, command: StateCommand) -> None:
        """Select pose commands and go on, or pause, by Servo's services; it needs no homing.

        Returns at once; a call that is refused or not answered is among the reading's problems.
        """
        if command == "enable":
            self._calls.put(f"{self._name}/switch_command_type", SWITCH, POSE)
        if command in PAUSES:
            self._calls.put(f"{self._name}/pause_servo", PAUSE, PAUSES[command])

    def close(self) -> None:
        """Hold, and leave the network; Servo is not paused.

        Raises:
            DeviceError: If the robot could not be held.
        """
        self._calls.close()
        super().close()

    @property
    def _frame_id(self) -> str:
        return self._base

    def _operating(self) -> Operating | None:
        status = self._status
        if status is None:
            return None
        is_fresh = self._clock.now_ns() - status[1] <= STATUS_AGE_NS
        return Operating(STATES.get(status[0], "FAULT") if is_fresh else "DISABLED", True, False)

    def _take_status(self, message: ServoStatus) -> None:
        if message.code not in STATES:
            self._input.report("status", f"unknown status {message.code} ({message.message})")
        self._status = message.code, self._clock.now_ns()

    def _take_static(self, message: TFMessage) -> None:
        self._tree.put(message, sender(message), is_static=True)

    def _take_tf(self, message: TFMessage) -> None:
        self._tree.put(message, sender(message), is_static=False)
        found = self._tree.pose(self._base, self._tool)
        if found is not None and found != self._found:
            self._found = found
            self._input.put(found.pose, found.stamp_ns, self._base, found.senders)


def servo_frames(argument: str) -> tuple[str, str, str]:
    """Return Servo's node, and the frames of base and tool.

    Raises:
        BadInput: If the argument is not NODE?base=FRAME&tool=FRAME.
    """
    name, _, query = argument.partition("?")
    if not name.strip("/"):
        raise BadInput("servo needs the name of Servo's node, for example servo:servo_node?tool=tool0")
    frames = dict(FRAMES)
    for key, values in parse_qs(query, keep_blank_values=True).items():
        if key not in FRAMES:
            raise BadInput(unknown_name("option of servo", key, FRAMES))
        frames[key] = values[-1].removeprefix("/")
    if not all(frames.values()):
        raise BadInput("servo: base and tool must be names of tf frames")
    return checked_topic(name.rstrip("/")), frames["base"], frames["tool"]
