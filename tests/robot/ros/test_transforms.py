import pytest

pytest.importorskip("cyclonedds")

from haptigraph.robot.pose import ToolPose
from haptigraph.robot.ros.transforms import TransformTree
from haptigraph.ros2.geometry_types import Quaternion, TFMessage, Transform, TransformStamped, Vector3
from haptigraph.ros2.types import Header, Time

QUARTER = Quaternion(0.0, 0.0, 0.5**0.5, 0.5**0.5)  # about z


def moved(parent, child, stamp_ns, x=0.0, rotation=None):
    header = Header(Time.from_ns(stamp_ns), parent)
    transform = Transform(Vector3(x, 0.0, 0.0), rotation or Quaternion(0.0, 0.0, 0.0, 1.0))
    return TransformStamped(header, child, transform)


def test_transforms_are_chained_and_the_oldest_stamp_counts():
    tree = TransformTree()
    tree.put(TFMessage([moved("base", "link", 300, 0.1, QUARTER)]), 1, is_static=False)
    assert tree.pose("base", "tool") is None
    tree.put(TFMessage([moved("link", "flange", 200, 0.2)]), 2, is_static=False)
    tree.put(TFMessage([moved("/flange", "/tool", 100, 0.05)]), 3, is_static=True)
    found = tree.pose("base", "tool")
    assert found.pose.position_mm == pytest.approx((100.0, 250.0, 0.0))
    assert found.pose.quaternion == pytest.approx((0.0, 0.0, 0.5**0.5, 0.5**0.5))
    assert (found.stamp_ns, found.senders) == (200, (3, 2, 1))


def test_a_frame_in_itself_is_the_identity():
    assert TransformTree().pose("base", "base").pose == ToolPose((0.0, 0.0, 0.0))


def test_an_invalid_transform_is_refused_and_the_others_are_taken():
    tree = TransformTree()
    bad = moved("base", "other", 1, rotation=Quaternion(0.0, 0.0, 0.0, 2.0))
    with pytest.raises(ValueError, match="the transform of other: a quaternion of length 2"):
        tree.put(TFMessage([bad, moved("base", "tool", 1, 0.1)]), 1, is_static=False)
    assert tree.pose("base", "tool").pose.position_mm == pytest.approx((100.0, 0.0, 0.0))
    assert tree.pose("base", "other") is None


def test_a_circle_of_frames_ends():
    tree = TransformTree()
    tree.put(TFMessage([moved("a", "b", 1), moved("b", "a", 1)]), 1, is_static=False)
    assert tree.pose("base", "a") is None
