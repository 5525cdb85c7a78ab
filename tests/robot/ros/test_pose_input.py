import pytest

from haptigraph.clock import VirtualClock
from haptigraph.robot.pose import ToolPose
from haptigraph.robot.ros.pose_input import PoseInput

UTC_NS = 1_790_000_000_000_000_000
MS = 1_000_000
POSE = ToolPose((1.0, 2.0, 3.0))


@pytest.fixture
def clock():
    return VirtualClock()


@pytest.fixture
def poses(clock):
    return PoseInput("crtk:PSM1", clock, lambda: clock.now_ns() + UTC_NS)


def put(clock, poses, time_ms, publisher=1, frame_id="base", stamp_ms=None):
    clock.wait_until(time_ms * MS)
    stamp_ms = time_ms - 5 if stamp_ms is None else stamp_ms
    poses.put(POSE, UTC_NS + stamp_ms * MS, frame_id, publisher)


def test_the_newest_pose_has_its_stamp_its_arrival_and_its_number(clock, poses):
    assert poses.read().pose is None
    for time_ms in (10, 20, 30):
        put(clock, poses, time_ms)
    reading = poses.read()
    assert (reading.stamp_ns, reading.received_ns, reading.number) == (25 * MS, 30 * MS, 3)
    assert (reading.pose, poses.frame_id, reading.problems) == (POSE, "base", ())


def test_another_frame_is_refused(clock, poses):
    put(clock, poses, 10)
    with pytest.raises(ValueError, match="a pose in frame 'tool'; the first was in 'base'"):
        put(clock, poses, 20, frame_id="tool")
    assert poses.read().number == 1


def test_of_two_publishers_none_is_believed(clock, poses):
    """Until one of them has been silent for half a second."""
    put(clock, poses, 10)
    for time_ms in range(20, 200, 10):
        with pytest.raises(ValueError, match="poses of two publishers at a time"):
            put(clock, poses, time_ms, publisher=time_ms // 10 % 2)
    for time_ms in range(200, 690, 10):  # the first one goes on alone
        with pytest.raises(ValueError, match="two publishers"):
            put(clock, poses, time_ms)
    assert poses.read().received_ns == 10 * MS
    for time_ms in range(690, 800, 10):
        put(clock, poses, time_ms)
    assert poses.read().received_ns == 790 * MS


def test_a_robot_that_was_started_again_is_heard_with_its_new_stamps(clock, poses):
    put(clock, poses, 5000)
    put(clock, poses, 5600, publisher=2, stamp_ms=-7_200_000)
    assert poses.read().number == 2
    assert "7205.6 s in the past" in poses.read().problems[0]


def test_each_kind_of_problem_is_reported_once(poses):
    for length in (1.1, 1.2, 1.3):
        poses.reject(f"a quaternion of length {length}, not 1")
    poses.reject("a pose that is not finite")
    assert poses.read().problems == (
        "crtk:PSM1: rejected a quaternion of length 1.1, not 1",
        "crtk:PSM1: rejected a pose that is not finite",
    )
    assert poses.read().problems == poses.read().problems
