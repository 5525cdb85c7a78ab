"""A leader arm with the CRTK interface (dVRK: MTML, MTMR; haptic devices), over DDS without ROS.

The displacement of its tip, in the arm's base, is the hand's: x to the right, y up, z towards the surgeon,
like the eye frame seen in the picture. `rotate` turns the base of an arm that has other axes. The arm's
orientation plays no part: the instrument pivots in the trocar.

The dead-man is that of the dVRK (https://github.com/jhu-dvrk/sawIntuitiveResearchKit/wiki/API-2.x): the hand
moves the robot while `console/operator_present` is pressed and the pedal `footpedals/clutch` is not.
"""

import math
from collections import deque
from collections.abc import Sequence
from threading import Lock
from urllib.parse import parse_qsl

import numpy as np
from numpy.typing import NDArray

from haptigraph.clock import Clock
from haptigraph.errors import BadInput, unknown_name
from haptigraph.ros2.motion_types import PoseStamped
from haptigraph.ros2.node import Node, checked_topic
from haptigraph.ros2.topics import topics_found
from haptigraph.ros2.types import Joy
from haptigraph.teleop.leaders.silence import Silence
from haptigraph.teleop.motion import HandMotion

__all__ = ["CrtkLeader", "PoseSteering", "arm_rotation", "is_pressed"]

OPTIONS = {"operator": "/console/operator_present", "clutch": "/footpedals/clutch", "rotate": "0,0,0"}
POSE = "/measured_cp"
SILENCE_MS = 100.0
"""The leader is lost after this time without a pose; CRTK arms publish at 100 Hz or more."""
MAX_JUMP_MM = 10.0
"""Largest displacement between two poses; beyond it the arm's frame has changed, or poses are missing."""
MAX_WAITING = 256
PRESSED = 1
"""Value of a pedal's button; 2 is a short tap."""


class PoseSteering:
    """Turn poses of a leader arm into hand motion. Messages may arrive in several threads.

    Args:
        rotation: From the arm's base to x right, y up, z towards the surgeon, (3, 3).
    """

    def __init__(self, rotation: NDArray[np.float64]) -> None:
        self._rotation = rotation
        self._lock = Lock()
        self._last_mm: tuple[float, float, float] | None = None
        self._is_present = self._is_clutched = False
        self._waiting: deque[HandMotion] = deque(maxlen=MAX_WAITING)

    def take_pose(self, message: PoseStamped) -> None:
        """Process `measured_cp`.

        Raises:
            ValueError: If it is not finite, or too far from the last one; the clutch is then released.
        """
        at = message.pose.position
        at_mm = 1000.0 * at.x, 1000.0 * at.y, 1000.0 * at.z
        with self._lock:
            last_mm, self._last_mm = self._last_mm, None
            is_finite = all(map(math.isfinite, at_mm))
            jump_mm = math.dist(at_mm, last_mm or at_mm) if is_finite else math.inf
            if jump_mm > MAX_JUMP_MM:
                self._last_mm = at_mm if is_finite else None
                self._waiting.append(HandMotion(engaged=False))
                raise ValueError(
                    f"a jump of {jump_mm:.3g} mm" if is_finite else "a position that is not finite"
                )
            moved_mm = np.subtract(at_mm, last_mm or at_mm)
            self._last_mm = at_mm
            right_mm, up_mm, towards_mm = (self._rotation @ moved_mm).tolist()
            engaged = self._is_present and not self._is_clutched
            self._waiting.append(
                HandMotion(True, along_mm=-up_mm, across_mm=right_mm, outwards_mm=towards_mm)
                if engaged
                else HandMotion(engaged=False)
            )

    def take_operator(self, message: Joy) -> None:
        """Process the dead-man: whether the operator is present."""
        with self._lock:
            self._is_present = is_pressed(message)
            self._note_release()

    def take_clutch(self, message: Joy) -> None:
        """Process the clutch pedal, which separates hand and robot while it is pressed."""
        with self._lock:
            self._is_clutched = is_pressed(message)
            self._note_release()

    def forget(self) -> None:
        """Begin anew after a loss: the operator must press again."""
        with self._lock:
            self._last_mm, self._is_present = None, False
            self._waiting.clear()

    def take(self) -> Sequence[HandMotion]:
        """Return the motions since the last call."""
        with self._lock:
            return tuple(self._waiting.popleft() for _ in range(len(self._waiting)))

    def _note_release(self) -> None:
        """Leave a release, so that one between two poses is not missed."""
        if not self._is_present or self._is_clutched:
            self._waiting.append(HandMotion(engaged=False))


class CrtkLeader:
    """Follow one arm.

    Args:
        argument: NAMESPACE, or NAMESPACE?operator=TOPIC&clutch=TOPIC&rotate=X,Y,Z; angles in degrees about
            the fixed axes x, then y, then z.
        clock: Measures since when the arm is silent.

    Raises:
        BadInput: If an option or a topic is not valid, or the network cannot be joined.
        MissingExtra: If cyclonedds is not installed.
    """

    def __init__(self, argument: str, clock: Clock) -> None:
        namespace, _, query = argument.partition("?")
        if not namespace:
            raise BadInput("leader crtk needs the arm's namespace, for example crtk:MTML")
        options = _options(query, argument)
        pose = checked_topic(f"{namespace}{POSE}")
        self._steering = PoseSteering(arm_rotation(options["rotate"], argument))
        self._silence = Silence(pose, SILENCE_MS, clock)
        self._node = Node()
        self._node.subscribe(pose, PoseStamped, self._receive, self._silence.reject)
        operator, clutch = checked_topic(options["operator"]), checked_topic(options["clutch"])
        self._node.subscribe(operator, Joy, self._steering.take_operator, self._silence.reject)
        for is_latched in (False, True):  # latched: a pedal that was pressed before the start, on the dVRK
            take, reject = self._steering.take_clutch, self._silence.reject
            self._node.subscribe(clutch, Joy, take, reject, is_latched=is_latched)

    @staticmethod
    def found() -> dict[str, str]:
        """Return the arms, of which only some are leaders, on the network: the argument of each."""
        arms = [topic.removesuffix(POSE) for topic in topics_found(Node.published) if topic.endswith(POSE)]
        return {f"crtk:{arm.strip('/')}": "on the ROS 2 network" for arm in arms}

    def take(self) -> Sequence[HandMotion]:
        """Return the motions since the last call."""
        try:
            self._silence.check()
        except Exception:
            self._steering.forget()
            raise
        return self._steering.take()

    def close(self) -> None:
        """Leave the network."""
        self._node.close()

    def _receive(self, message: PoseStamped) -> None:
        self._steering.take_pose(message)
        self._silence.heard()


def is_pressed(message: Joy) -> bool:
    """Return whether a pedal is pressed."""
    return bool(message.buttons) and message.buttons[0] == PRESSED


def _options(query: str, argument: str) -> dict[str, str]:
    given = dict(parse_qsl(query, keep_blank_values=True))
    for name in given.keys() - OPTIONS.keys():
        raise BadInput(unknown_name("option", name, OPTIONS), f"crtk:{argument}")
    return {**OPTIONS, **given}


def arm_rotation(text: str, argument: str) -> NDArray[np.float64]:
    """Return the rotation of angles about the fixed axes x, y, z [deg], (3, 3)."""
    try:
        angles = [math.radians(float(part)) for part in text.split(",")]
    except ValueError:
        angles = []
    if len(angles) != 3 or not all(map(math.isfinite, angles)):
        raise BadInput(f"rotate={text}: expected three angles in degrees, such as 0,0,90", f"crtk:{argument}")
    rotation = np.eye(3)
    for axis, angle in enumerate(angles):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        turn = np.eye(3)
        turn[first, first] = turn[second, second] = math.cos(angle)
        turn[second, first], turn[first, second] = math.sin(angle), -math.sin(angle)
        rotation = turn @ rotation
    return rotation
