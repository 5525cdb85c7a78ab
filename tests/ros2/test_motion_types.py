import pytest

pytest.importorskip("cyclonedds")

from haptigraph.ros2 import motion_types
from haptigraph.ros2.geometry_types import Pose, Quaternion, Vector3
from haptigraph.ros2.types import Header, Point, Time

HEADER = Header(Time(3, 4), "base")
MESSAGES = [
    motion_types.PoseStamped(HEADER, Pose(Point(1.0, 2.0, 3.0), Quaternion(0.0, 0.6, 0.0, 0.8))),
    motion_types.TwistStamped(HEADER, motion_types.Twist(Vector3(1.0, 2.0, 3.0), Vector3(4.0, 5.0, 6.0))),
    motion_types.WrenchStamped(HEADER, motion_types.Wrench(Vector3(1.0, 2.0, 3.0), Vector3(4.0, 5.0, 6.0))),
    motion_types.OperatingState(HEADER, "ENABLED", True, False),
    motion_types.StringStamped(HEADER, "enable"),
    motion_types.ServoStatus(-1, "invalid"),
]


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: type(message).__name__)
def test_messages_arrive_unchanged(peer, message):
    peer.subscribe("/message", type(message))
    peer.publisher("/message", type(message)).send(message)
    assert peer.next("/message") == message
