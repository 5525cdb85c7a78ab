"""Faults of a CRTK robot: lost, late, doubled, or under another name."""

import time
import uuid

import pytest
from ros_network import robot_peer, until

pytest.importorskip("cyclonedds")

from haptigraph.clock import MonotonicClock
from haptigraph.errors import DeviceError
from haptigraph.robot.ros.crtk import CrtkRobot
from haptigraph.ros2.geometry_types import Pose, Quaternion, Vector3
from haptigraph.ros2.motion_types import OperatingState, PoseStamped, Wrench, WrenchStamped
from haptigraph.ros2.types import Header, Point, Time

pytestmark = pytest.mark.realtime


@pytest.fixture
def name(ros_network):
    """A namespace of its own: DDS counts a killed program among the subscribers for seconds."""
    return f"arm_{uuid.uuid4().hex}"


@pytest.fixture
def robot(name):
    opened = CrtkRobot(name, MonotonicClock())
    yield opened
    opened.close()


def age_ms(robot):
    return (time.monotonic_ns() - robot.read().stamp_ns) / 1e6


def pose(frame_id="base", at_m=(0.1, 0.0, 0.05), turn=(0.0, 0.0, 0.0, 1.0)):
    header = Header(Time.from_ns(time.time_ns()), frame_id)
    return PoseStamped(header, Pose(Point(*at_m), Quaternion(*turn)))


def test_a_robot_that_comes_late_is_found_and_a_dead_one_grows_old(robot, name):
    assert robot.read().pose is None
    with pytest.raises(DeviceError, match="nobody subscribes to state_command"):
        robot.request("enable")
    with robot_peer("crtk", f"/{name}") as process:
        until(lambda: robot.read().number > 10, "the robot is not found")
        until(lambda: age_ms(robot) < 60, "its poses are old")
        process.kill()
        until(lambda: age_ms(robot) > 200, "a dead robot has new poses")


def test_a_network_that_loses_every_pose_leaves_the_state_and_an_old_pose(robot, name):
    with robot_peer("crtk", f"/{name}") as process:
        until(lambda: robot.read().operating is not None, "no state")
        process.stdin.write("quiet\n")
        until(lambda: age_ms(robot) > 300, "poses do not grow old")
        process.stdin.write("fault\n")
        until(lambda: robot.read().operating.state == "FAULT", "the state does not follow")


def test_of_two_robots_with_one_name_none_is_believed(robot, name):
    with robot_peer("crtk", f"/{name}"):
        until(lambda: robot.read().number > 10, "the robot is not found")
        with robot_peer("crtk", f"/{name}"):
            until(lambda: age_ms(robot) > 200, "poses of two robots are used")
            assert any("two publishers" in problem for problem in robot.read().problems)


def test_another_name_is_another_robot(robot, name):
    with robot_peer("crtk", f"/{name}_2"):
        time.sleep(1.0)
        assert robot.read().number == 0


def test_a_state_that_was_sent_before_is_received(name, peer):
    """Robots that publish it only when it changes let nodes receive it that come later."""
    from haptigraph.ros2 import qos

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("haptigraph.ros2.node.publisher_profile", lambda topic: qos.TF_STATIC)
        publisher = peer.node.publisher(f"/{name}/operating_state", OperatingState)
    publisher.send(OperatingState(Header(), "PAUSED", True, False))
    robot = CrtkRobot(name, MonotonicClock())
    until(lambda: robot.read().operating is not None, "the state is not received")
    assert robot.read().operating.state == "PAUSED"
    robot.close()


def test_invalid_messages_are_reported_and_never_used(robot, name, peer):
    poses = peer.publisher(f"/{name}/measured_cp", PoseStamped)
    states = peer.publisher(f"/{name}/operating_state", OperatingState)
    forces = peer.publisher(f"/{name}/measured_cf", WrenchStamped)
    poses.send(pose())
    until(lambda: robot.read().number == 1, "the pose is not received")
    for message in (
        pose(at_m=(float("nan"), 0.0, 0.0)),
        pose(turn=(0.0, 0.0, 0.0, 2.0)),
        pose(at_m=(100.0, 0.0, 50.0)),
        pose(frame_id="tool"),
    ):
        poses.send(message)
    states.send(OperatingState(Header(), "READY", True, False))
    forces.send(WrenchStamped(Header(Time(), "tool"), Wrench(Vector3(1.0, 0.0, 0.0))))
    until(lambda: len(robot.read().problems) >= 6, f"only {robot.read().problems} were reported")
    assert robot.read().number == 1
    assert robot.read().operating is None
    assert robot.read().force_n is None


def test_an_old_force_is_not_reported(robot, name, peer):
    poses = peer.publisher(f"/{name}/measured_cp", PoseStamped)
    forces = peer.publisher(f"/{name}/measured_cf", WrenchStamped)
    poses.send(pose())
    until(lambda: robot.read().number == 1, "the pose is not received")
    force = WrenchStamped(Header(Time(), "base"), Wrench(Vector3(0.1, 0.2, 0.3)))

    def is_reported():
        forces.send(force)
        return robot.read().force_n == (0.1, 0.2, 0.3)

    until(is_reported, "no force")
    until(lambda: robot.read().force_n is None, "an old force is reported")
