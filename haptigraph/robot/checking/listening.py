"""Record the topics of a robot, and, only if asked, enable it and command its own pose."""

import threading
import time
from collections.abc import Callable, Iterator
from copy import deepcopy
from functools import partial
from typing import Any, NamedTuple

from cyclonedds.idl import IdlStruct

from haptigraph.errors import BadInput, unknown_name
from haptigraph.findings import Finding
from haptigraph.robot.checking.recorded import Recorded
from haptigraph.robot.checking.states import ENABLE_S, Enabling
from haptigraph.robot.ros.crtk import namespace_of
from haptigraph.robot.ros.servo import STATES as SERVO_STATES
from haptigraph.robot.ros.servo import servo_frames
from haptigraph.robot.ros.transforms import TransformTree
from haptigraph.ros2.endpoints import sender
from haptigraph.ros2.geometry_types import JointState, Pose, Quaternion, TFMessage
from haptigraph.ros2.motion_types import (
    OperatingState,
    PoseStamped,
    ServoStatus,
    StringStamped,
    TwistStamped,
    WrenchStamped,
)
from haptigraph.ros2.node import Node, Publisher
from haptigraph.ros2.types import Header, Point, Time

__all__ = ["CrtkListener", "Listener", "ServoListener", "listener"]

DISCOVERY_S = 1.0
TICK_S = 0.005
ECHO_S = 1.0
ECHO_M = 1e-6  # a set point this near to the command is the command
STILL_M = 1e-3
STILL_POSES = 20


class _Topic(NamedTuple):
    name: str
    message_type: type[IdlStruct]
    take: Callable[[Any, int, int], None]


class Listener:
    """Record a robot's topics from the moment it is opened.

    Args:
        topics: Its topics, with full ROS names.
        command: The topic on which it takes poses.
        recorded: Receives the messages.
    """

    def __init__(self, topics: list[_Topic], command: str, recorded: Recorded) -> None:
        self.recorded, self._topics, self._command = recorded, topics, command
        self._node, self._lock = Node(), threading.Lock()
        self._commands = 0
        for topic in (*topics, _Topic(command, PoseStamped, self._count)):
            for is_latched in (False, True) if topic.message_type is OperatingState else (False,):
                take, reject = partial(self._take, topic.take), recorded.reject
                self._node.subscribe(topic.name, topic.message_type, take, reject, is_latched=is_latched)

    def snapshot(self) -> Recorded:
        """Return what was recorded until now."""
        with self._lock:
            return deepcopy(self.recorded)

    def presence(self) -> tuple[Finding, ...]:
        """Return the findings about topics that are absent or of another type, and about other commanders."""
        return tuple(self._presence())

    def enable(self) -> Enabling:
        """Enable the robot, command it its own pose, and disable it again if it was not enabled.

        Raises:
            BadInput: If this robot takes no such command.
        """
        raise BadInput("--enable goes with crtk robots; MoveIt Servo is enabled by its services")

    def close(self) -> None:
        """Leave the network."""
        self._node.close()

    def _presence(self) -> Iterator[Finding]:
        for topic in self._topics:
            expected = topic.message_type.__idl_typename__.replace(".", "::")
            others = sorted({one.type_name for one in self._node.publishers(topic.name)} - {expected})
            if others:
                yield Finding(
                    "topic_type",
                    f"{topic.name} has messages of type {', '.join(map(_ros_type, others))}; "
                    f"{_ros_type(expected)} is valid",
                )
        expected = PoseStamped.__idl_typename__.replace(".", "::")
        listeners = [one.type_name for one in self._node.subscribers(self._command)]
        listeners.remove(expected)  # this program's own
        if expected not in listeners:
            found = (
                f"subscribed to as {', '.join(map(_ros_type, listeners))}"
                if listeners
                else "not subscribed to"
            )
            yield Finding(
                "command_type",
                f"{self._command} is {found}; the robot must subscribe to geometry_msgs/PoseStamped",
            )
        if self._commands:
            yield Finding(
                "commanded",
                f"another program sent {self._commands} commands on {self._command}; stop it, only one may "
                "steer",
            )

    def _take(self, take: Callable[[Any, int, int], None], message: IdlStruct) -> None:
        with self._lock:
            take(message, time.time_ns(), sender(message))

    def _count(self, message: PoseStamped, received_utc_ns: int, sent_by: int) -> None:
        self._commands += 1


class CrtkListener(Listener):
    """Record the topics of a CRTK robot.

    Args:
        argument: Its namespace.
    """

    def __init__(self, argument: str) -> None:
        root, recorded = namespace_of(argument), Recorded(time.time_ns())
        self._root = root
        super().__init__(
            [
                _Topic(f"{root}/measured_cp", PoseStamped, recorded.take_pose),
                _Topic(f"{root}/measured_cv", TwistStamped, recorded.take_twist),
                _Topic(f"{root}/measured_cf", WrenchStamped, recorded.take_wrench),
                _Topic(f"{root}/measured_js", JointState, recorded.take_joints),
                _Topic(f"{root}/setpoint_cp", PoseStamped, recorded.take_setpoint),
                _Topic(f"{root}/operating_state", OperatingState, recorded.take_state),
            ],
            f"{root}/servo_cp",
            recorded,
        )

    def enable(self) -> Enabling:
        """Enable the robot, command it its own pose, and disable it again if it was disabled."""
        requests = self._node.publisher(f"{self._root}/state_command", StringStamped)
        commands = self._node.publisher(f"{self._root}/servo_cp", PoseStamped)
        threading.Event().wait(DISCOVERY_S)
        before = self._state()
        sent_ns = time.monotonic_ns()
        requests.send(StringStamped(_header(""), "enable"))
        if not _until(lambda: self._state() == "ENABLED", ENABLE_S):
            return Enabling(None, None)
        enabled_ms = (time.monotonic_ns() - sent_ns) / 1e6
        echo_ms = self._echo_ms(commands)
        if before == "DISABLED":
            requests.send(StringStamped(_header(""), "disable"))
            _until(lambda: self._state() == "DISABLED", ENABLE_S)
        return Enabling(enabled_ms, echo_ms)

    def _state(self) -> str:
        states = self.recorded.states
        return states[-1].state if states else ""

    def _echo_ms(self, commands: Publisher) -> float | None:
        """Command the pose at which the robot stands, and measure until it is the set point."""
        numbers = self.snapshot().poses.samples().numbers[-STILL_POSES:]
        if len(numbers) < STILL_POSES or (numbers.max(axis=0) - numbers.min(axis=0))[:3].max() > STILL_M:
            return None
        frame_id = next(iter(self.recorded.poses.frame_ids))
        target = numbers[-1]
        pose = Pose(Point(*target[:3].tolist()), Quaternion(*target[3:].tolist()))
        known, sent_ns = len(self.recorded.setpoints), time.monotonic_ns()
        commands.send(PoseStamped(_header(frame_id), pose))

        def is_echoed() -> bool:
            with self._lock:  # no copy of everything: messages would wait, and count as late
                setpoints = self.recorded.setpoints.samples().numbers[known:]
            return bool(len(setpoints)) and bool(abs(setpoints[-1, :3] - target[:3]).max() < ECHO_M)

        return (time.monotonic_ns() - sent_ns) / 1e6 if _until(is_echoed, ECHO_S) else None


class ServoListener(Listener):
    """Record tf and the status of MoveIt Servo.

    Args:
        argument: Its node and frames.
    """

    def __init__(self, argument: str) -> None:
        node_name, self._base, self._tool = servo_frames(argument)
        recorded, self._tree = Recorded(time.time_ns()), TransformTree()
        super().__init__(
            [
                _Topic("/tf", TFMessage, self._take_tf),
                _Topic("/tf_static", TFMessage, self._take_static),
                _Topic(f"{node_name}/status", ServoStatus, self._take_status),
            ],
            f"{node_name}/pose_target_cmds",
            recorded,
        )

    def _take_static(self, message: TFMessage, received_utc_ns: int, sent_by: int) -> None:
        self._tree.put(message, sent_by, is_static=True)

    def _take_tf(self, message: TFMessage, received_utc_ns: int, sent_by: int) -> None:
        self._tree.put(message, sent_by, is_static=False)
        found = self._tree.pose(self._base, self._tool)
        if found is None:
            return
        at_m = (length_mm / 1e3 for length_mm in found.pose.position_mm)
        header = Header(Time.from_ns(found.stamp_ns), self._base)
        numbers = (*at_m, *found.pose.quaternion)
        self.recorded.poses.add(header, received_utc_ns, hash(found.senders), numbers)

    def _take_status(self, message: ServoStatus, received_utc_ns: int, sent_by: int) -> None:
        state = SERVO_STATES.get(message.code, f"status {message.code}")
        self.recorded.take_state(OperatingState(_header(""), state, True, False), received_utc_ns, sent_by)


LISTENERS: dict[str, type[CrtkListener] | type[ServoListener]] = {
    "crtk": CrtkListener,
    "servo": ServoListener,
}


def listener(uri: str) -> Listener:
    """Listen to a robot by KIND:ARGUMENT.

    Raises:
        BadInput: If its interface cannot be checked, or the network cannot be joined.
        MissingExtra: If cyclonedds is not installed.
    """
    kind, _, argument = uri.partition(":")
    if kind == "simulated":
        raise BadInput("a simulated robot needs no check; check crtk:NAMESPACE or servo:NODE")
    if kind not in LISTENERS:
        raise BadInput(unknown_name("robot", kind, LISTENERS))
    return LISTENERS[kind](argument)


def _header(frame_id: str) -> Header:
    return Header(Time.from_ns(time.time_ns()), frame_id)


def _ros_type(type_name: str) -> str:
    """Return the ROS name of a DDS type: geometry_msgs::msg::dds_::Pose_ -> geometry_msgs/Pose."""
    parts = type_name.split("::")
    return f"{parts[0]}/{parts[-1].removesuffix('_')}"


def _until(holds: Callable[[], bool], timeout_s: float) -> bool:
    tick = threading.Event()
    end_s = time.monotonic() + timeout_s
    while not holds():
        if time.monotonic() > end_s:
            return False
        tick.wait(TICK_S)
    return True
