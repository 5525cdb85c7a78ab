"""A leader arm with the CRTK interface (dVRK: MTML, MTMR; haptic devices), over DDS without ROS.

The arm publishes `measured_cp` and `measured_cv` and accepts `servo_cf`, in its base: metres, m/s, newtons.
The clutch is that of the leader `crtk`: the operator is present, and the clutch pedal is not pressed.
"""

import math
import threading
import time
from urllib.parse import parse_qsl

import numpy as np

from haptigraph.clock import Clock
from haptigraph.errors import BadInput, DeviceError, unknown_name
from haptigraph.haptics.force.interface import ForceCapabilities, HandReading
from haptigraph.robot.pose import Vec3

__all__ = ["CrtkForce"]

OPTIONS = {
    "operator": "/console/operator_present",
    "clutch": "/footpedals/clutch",
    "wrench": "servo_cf",
    "rotate": "0,0,0",
}
POSE, VELOCITY = "/measured_cp", "/measured_cv"
COMMAND = "/servo_cf"
DISCOVERY_S = 2.0
LOST_NS = 100_000_000
"""Without a pose for this time the arm counts as lost; CRTK arms publish at 100 Hz or more."""
LIMIT_N, LIMIT_MM_S = 2.0, 250.0
ZEROS, PAUSE_S = 25, 0.002  # wrenches of zero at the end, in case one is lost
ZERO: Vec3 = (0.0, 0.0, 0.0)


class CrtkForce:
    """Push the hand at one arm. Opening waits for the arm.

    Args:
        argument: NAMESPACE, or NAMESPACE?wrench=TOPIC&operator=TOPIC&clutch=TOPIC&rotate=X,Y,Z; `wrench` is
            relative to the namespace, angles are in degrees about the fixed axes x, then y, then z.
        clock: Stamps the readings.

    Raises:
        BadInput: If an option is not valid, or there is no such arm.
        MissingExtra: If cyclonedds is not installed.
    """

    capabilities = ForceCapabilities(
        max_force_n=LIMIT_N,
        rate_hz=100.0,  # of the poses; forces are published in every exchange
        max_speed_mm_s=LIMIT_MM_S,
        delay_ms=10.0,
        limitations="Never tried on hardware. The arm must accept servo_cf, in the axes of measured_cp.",
    )

    def __init__(self, argument: str, clock: Clock) -> None:
        # Imported here, so that the capabilities are available without the extra.
        from haptigraph.ros2 import geometry_types, motion_types, types  # noqa: PLC0415
        from haptigraph.ros2.node import Node, checked_topic  # noqa: PLC0415
        from haptigraph.teleop.leaders.crtk import arm_rotation, is_pressed  # noqa: PLC0415

        namespace, options = _parsed(argument)
        self._types, self._geometry, self._motion = types, geometry_types, motion_types
        self._clock, self._is_pressed = clock, is_pressed
        self._rotation = arm_rotation(options["rotate"], argument)
        self._lock = threading.Lock()
        self._is_present = self._is_clutched = self._is_closed = False
        self._position_mm = self._velocity_mm_s = ZERO
        self._stamp_ns: int | None = None
        self._problem = ""
        self._node = Node()
        pose, velocity = checked_topic(f"{namespace}{POSE}"), checked_topic(f"{namespace}{VELOCITY}")
        self._topic = checked_topic(f"{namespace}/{options['wrench']}")
        self._publisher = self._node.publisher(self._topic, motion_types.WrenchStamped)
        self._node.subscribe(pose, motion_types.PoseStamped, self._take_pose, self._reject)
        self._node.subscribe(velocity, motion_types.TwistStamped, self._take_velocity, self._reject)
        operator, clutch = checked_topic(options["operator"]), checked_topic(options["clutch"])
        self._node.subscribe(operator, types.Joy, self._take_operator, self._reject)
        for is_latched in (False, True):
            self._node.subscribe(clutch, types.Joy, self._take_clutch, self._reject, is_latched=is_latched)
        self._await_arm(pose)

    @staticmethod
    def found() -> dict[str, str]:
        """Return the arms that accept a force: the argument and the ROS domain of each."""
        from haptigraph.ros2.node import Node, domain_id  # noqa: PLC0415
        from haptigraph.ros2.topics import topics_found  # noqa: PLC0415

        topics = [topic for topic in topics_found(Node.subscribed) if topic.endswith(COMMAND)]
        arms = [topic.removesuffix(COMMAND).strip("/") for topic in topics]
        return {f"crtk:{arm}": f"accepts servo_cf on ROS domain {domain_id()}" for arm in arms}

    def exchange(self, force_n: Vec3) -> HandReading:
        """Publish a force, and return the newest pose.

        Raises:
            DeviceError: If the arm is lost, or does not subscribe.
        """
        self._publish(force_n)
        if not self._publisher.has_subscribers:
            raise DeviceError(f"no arm subscribes to {self._topic} (ROS domain {self._node.domain})")
        with self._lock:
            stamp_ns, is_engaged = self._stamp_ns or 0, self._is_present and not self._is_clutched
            reading = HandReading(stamp_ns, self._position_mm, self._velocity_mm_s, is_engaged)
        if self._clock.now_ns() - stamp_ns > LOST_NS:
            raise DeviceError(f"the arm of {self._topic} is silent{self._problem}")
        return reading

    def close(self) -> None:
        """Publish forces of zero, and leave the network. May be called twice.

        Raises:
            DeviceError: If the arm does not subscribe any more.
        """
        if self._is_closed:
            return
        self._is_closed = True
        try:
            for _ in range(ZEROS):
                self._publish(ZERO)
                time.sleep(PAUSE_S)
            if not self._publisher.has_subscribers:
                raise DeviceError(f"no arm subscribes to {self._topic}: it may keep its last force")
        finally:
            self._node.close()

    def _await_arm(self, pose: str) -> None:
        """Wait until the arm publishes and subscribes; then its force is zero."""
        self._node.await_subscribers(DISCOVERY_S)
        give_up_ns = self._clock.now_ns() + round(DISCOVERY_S * 1e9)
        while self._stamp_ns is None and self._clock.now_ns() < give_up_ns:
            time.sleep(PAUSE_S)
        problem = "" if self._publisher.has_subscribers else f"no arm subscribes to {self._topic}"
        if self._stamp_ns is None:
            problem = problem or f"no arm publishes {pose}{self._problem}"
        if problem:
            self._node.close()
            raise BadInput(f"{problem} (ROS domain {self._node.domain})", "force device crtk")
        self._publish(ZERO)

    def _publish(self, force_n: Vec3) -> None:
        x, y, z = (self._rotation.T @ force_n).tolist()
        header = self._types.Header(self._types.Time.from_ns(time.time_ns()))
        wrench = self._motion.Wrench(self._geometry.Vector3(x, y, z))
        try:
            self._publisher.send(self._motion.WrenchStamped(header, wrench))
        except OSError as error:
            raise DeviceError(f"{self._topic} cannot be published ({error})") from None

    def _take_pose(self, message: object) -> None:
        at = message.pose.position  # type: ignore[attr-defined]
        position_mm = self._ours_mm(at.x, at.y, at.z)
        with self._lock:
            self._position_mm, self._stamp_ns = position_mm, self._clock.now_ns()

    def _take_velocity(self, message: object) -> None:
        at = message.twist.linear  # type: ignore[attr-defined]
        velocity_mm_s = self._ours_mm(at.x, at.y, at.z)
        with self._lock:
            self._velocity_mm_s = velocity_mm_s

    def _take_operator(self, message: object) -> None:
        self._is_present = self._is_pressed(message)  # type: ignore[arg-type]

    def _take_clutch(self, message: object) -> None:
        self._is_clutched = self._is_pressed(message)  # type: ignore[arg-type]

    def _reject(self, problem: str) -> None:
        self._problem = f" ({problem})"

    def _ours_mm(self, x: float, y: float, z: float) -> Vec3:
        """Return a vector of the arm's base [m] in our axes [mm].

        Raises:
            ValueError: If it is not finite.
        """
        if not all(map(math.isfinite, (x, y, z))):
            raise ValueError("a number that is not finite")
        right, up, towards = (1e3 * (self._rotation @ np.array((x, y, z)))).tolist()
        return right, up, towards


def _parsed(argument: str) -> tuple[str, dict[str, str]]:
    namespace, _, query = argument.partition("?")
    if not namespace:
        raise BadInput("force device crtk needs the arm's namespace, for example crtk:MTML")
    given = dict(parse_qsl(query, keep_blank_values=True))
    for name in given.keys() - OPTIONS.keys():
        raise BadInput(unknown_name("option", name, OPTIONS), f"crtk:{argument}")
    return namespace, {**OPTIONS, **given}
