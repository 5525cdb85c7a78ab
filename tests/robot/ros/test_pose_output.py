import pytest

pytest.importorskip("cyclonedds")

from haptigraph.clock import VirtualClock
from haptigraph.errors import DeviceError
from haptigraph.robot.interface import Operating, RobotReading
from haptigraph.robot.pose import ToolPose
from haptigraph.robot.ros.pose_output import PoseOutput

MS = 1_000_000
ENABLED, PAUSED = Operating("ENABLED", True, False), Operating("PAUSED", True, False)
COMMANDED = ToolPose((1.0, 2.0, 3.0))


class FakePublisher:
    def __init__(self):
        self.sent, self.has_subscribers, self.error = [], True, None

    def send(self, message):
        if self.error is not None:
            raise self.error
        self.sent.append(message)


class FakeNode:
    def __init__(self):
        self.opened = FakePublisher()

    def publisher(self, topic, message_type):
        return self.opened


@pytest.fixture
def node():
    return FakeNode()


@pytest.fixture
def clock():
    return VirtualClock(100 * MS)


@pytest.fixture
def output(node, clock):
    return PoseOutput(node, "/PSM1/servo_cp", clock)


def reading(x_mm=1.0, operating=ENABLED, stamp_ns=90 * MS):
    return RobotReading(stamp_ns, stamp_ns, ToolPose((x_mm, 2.0, 3.0)), operating)


def held_at_mm(node):
    return 1e3 * node.opened.sent[-1].pose.position.x


def test_a_pose_is_sent_in_metres_in_the_frame_of_the_robot(node, output):
    output.move(COMMANDED, 105 * MS, "base")
    message = node.opened.sent[0]
    assert (message.pose.position.x, message.pose.position.y) == pytest.approx((0.001, 0.002))
    assert message.header.frame_id == "base"


def test_a_robot_that_was_not_moved_is_not_commanded_by_a_hold(node, output):
    output.hold(0, reading(), "base")
    assert node.opened.sent == []


def test_a_hold_repeats_the_last_command(node, output):
    """Not the measured pose, whose noise would carry the shaft off the remote centre."""
    output.move(COMMANDED, 0, "base")
    for x_mm in (1.4, 0.7, 1.1):
        output.hold(0, reading(x_mm), "base")
        assert held_at_mm(node) == pytest.approx(1.0)
    assert len(node.opened.sent) == 4


def test_a_robot_that_does_not_follow_is_held_where_it_is(node, output):
    output.move(COMMANDED, 0, "base")
    output.hold(0, reading(4.0), "base")
    output.hold(0, reading(4.3), "base")  # and stays there, although it drifts
    assert held_at_mm(node) == pytest.approx(4.0)


def test_a_stale_measurement_holds_nothing(node, output):
    output.move(COMMANDED, 0, "base")
    output.hold(0, reading(4.0, stamp_ns=-50 * MS), "base")
    assert held_at_mm(node) == pytest.approx(1.0)


def test_a_robot_that_is_paused_receives_nothing_and_jumps_to_no_old_pose_afterwards(node, output):
    output.move(COMMANDED, 0, "base")
    output.hold(0, reading(operating=PAUSED), "base")
    output.hold(0, reading(8.0), "base")  # it was moved by hand meanwhile
    assert len(node.opened.sent) == 1


def test_a_hold_ends_so_that_another_program_can_take_over(node, clock, output):
    output.move(COMMANDED, 0, "base")
    for time_ms in range(100, 2000, 5):
        clock.wait_until(time_ms * MS)
        output.hold(0, reading(), "base")
    assert 100 <= len(node.opened.sent) <= 102


def test_what_cannot_be_sent_is_an_error(node, output):
    with pytest.raises(ValueError, match="is not a pose"):
        output.move(ToolPose((float("nan"), 0.0, 0.0)), 0, "base")
    assert node.opened.sent == []
    node.opened.has_subscribers = False
    with pytest.raises(DeviceError, match="nobody subscribes to /PSM1/servo_cp"):
        output.move(COMMANDED, 0, "base")
    node.opened.error = OSError("closed")
    with pytest.raises(DeviceError, match=r"/PSM1/servo_cp cannot be published \(closed\)"):
        output.hold(0, reading(), "base")
