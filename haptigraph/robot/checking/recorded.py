"""What a robot's topics said while they were recorded, in their own units."""

from collections import Counter
from typing import NamedTuple

import numpy as np

from haptigraph.robot.pose import Floats
from haptigraph.ros2.geometry_types import JointState, Quaternion, Vector3
from haptigraph.ros2.motion_types import OperatingState, PoseStamped, TwistStamped, WrenchStamped
from haptigraph.ros2.types import Header, Point

__all__ = ["Recorded", "Samples", "Series", "StateSample"]

EMPTY = np.zeros((0, 0))


class StateSample(NamedTuple):
    """One operating state."""

    received_ns: int
    state: str
    is_homed: bool


class Samples(NamedTuple):
    """Messages of one topic as arrays over the messages."""

    stamp_s: Floats
    """Of the robot's machine, since the start."""
    received_s: Floats
    """When they arrived, by this machine's clock, since the start."""
    numbers: Floats
    """(n, m)."""

    @property
    def age_s(self) -> Floats:
        """From stamp to arrival."""
        age_s: Floats = self.received_s - self.stamp_s
        return age_s


class Series:
    """Messages of one topic.

    Args:
        start_utc_ns: Start of the record, UTC of this machine [ns].
    """

    def __init__(self, start_utc_ns: int) -> None:
        self._start_utc_ns = start_utc_ns
        self.senders: Counter[int] = Counter()
        self.frame_ids: Counter[str] = Counter()
        self.unstamped = 0
        self._rows: list[tuple[int, int, tuple[float, ...]]] = []

    def __len__(self) -> int:
        return len(self._rows)

    def add(self, header: Header, received_utc_ns: int, sender: int, numbers: tuple[float, ...]) -> None:
        """Add one message.

        Args:
            header: Its header.
            received_utc_ns: When it was received, UTC of this machine [ns].
            sender: Identifies the publisher.
            numbers: Its contents, always as many.
        """
        self.senders[sender] += 1
        self.frame_ids[header.frame_id] += 1
        self.unstamped += not header.stamp.ns
        if not self._rows or len(numbers) == len(self._rows[0][2]):
            self._rows.append((header.stamp.ns, received_utc_ns, numbers))

    def samples(self) -> Samples:
        """Return the messages as arrays."""
        times_ns = np.array([row[:2] for row in self._rows], dtype=np.int64).reshape(-1, 2)
        numbers = np.array([row[2] for row in self._rows], dtype=np.float64)
        stamp_s, received_s = ((times_ns - self._start_utc_ns) / 1e9).T
        return Samples(stamp_s, received_s, numbers.reshape(len(self._rows), -1) if numbers.size else EMPTY)


class Recorded:
    """All topics of one robot. The methods `take_*` are called with every message.

    Args:
        start_utc_ns: Start of the record, UTC of this machine [ns].
    """

    def __init__(self, start_utc_ns: int) -> None:
        self.poses, self.twists, self.joints, self.wrenches, self.setpoints = (
            Series(start_utc_ns) for _ in range(5)
        )
        self.states: list[StateSample] = []
        self.state_senders: Counter[int] = Counter()
        self.rejected: Counter[str] = Counter()

    def take_pose(self, message: PoseStamped, received_utc_ns: int, sender: int) -> None:
        """Add a message of measured_cp: position [m], quaternion."""
        numbers = (*_xyz(message.pose.position), *_xyzw(message.pose.orientation))
        self.poses.add(message.header, received_utc_ns, sender, numbers)

    def take_setpoint(self, message: PoseStamped, received_utc_ns: int, sender: int) -> None:
        """Add a message of setpoint_cp: position [m], quaternion."""
        numbers = (*_xyz(message.pose.position), *_xyzw(message.pose.orientation))
        self.setpoints.add(message.header, received_utc_ns, sender, numbers)

    def take_twist(self, message: TwistStamped, received_utc_ns: int, sender: int) -> None:
        """Add a message of measured_cv: velocity [m/s], angular velocity [rad/s]."""
        numbers = (*_xyz(message.twist.linear), *_xyz(message.twist.angular))
        self.twists.add(message.header, received_utc_ns, sender, numbers)

    def take_wrench(self, message: WrenchStamped, received_utc_ns: int, sender: int) -> None:
        """Add a message of measured_cf: force [N]."""
        self.wrenches.add(message.header, received_utc_ns, sender, _xyz(message.wrench.force))

    def take_joints(self, message: JointState, received_utc_ns: int, sender: int) -> None:
        """Add a message of measured_js: positions [rad or m]."""
        self.joints.add(message.header, received_utc_ns, sender, tuple(message.position))

    def take_state(self, message: OperatingState, received_utc_ns: int, sender: int) -> None:
        """Add a message of operating_state."""
        self.state_senders[sender] += 1
        self.states.append(StateSample(received_utc_ns, message.state, message.is_homed))

    def reject(self, problem: str) -> None:
        """Count a message that cannot be decoded."""
        self.rejected[problem] += 1


def _xyz(vector: Point | Vector3) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def _xyzw(rotation: Quaternion) -> tuple[float, float, float, float]:
    return rotation.x, rotation.y, rotation.z, rotation.w
