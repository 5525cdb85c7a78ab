import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ros_network import until

pytest.importorskip("cyclonedds")

from haptigraph.clock import VirtualClock
from haptigraph.errors import BadInput
from haptigraph.ros2.geometry_types import Pose, Quaternion
from haptigraph.ros2.motion_types import PoseStamped
from haptigraph.ros2.qos import Profile
from haptigraph.ros2.types import Header, Joy, Point
from haptigraph.teleop.leaders.crtk import MAX_JUMP_MM, CrtkLeader, PoseSteering, arm_rotation


def pose(*at_mm):
    return PoseStamped(Header(), Pose(Point(*(each / 1000 for each in at_mm)), Quaternion()))


def pedal(value):
    return Joy(Header(), [], [value])


@pytest.fixture
def steering():
    steering = PoseSteering(np.eye(3))
    steering.take_operator(pedal(1))
    steering.take_pose(pose(0, 0, 0))
    steering.take()
    return steering


def test_the_hand_moves_as_its_tip_is_seen_in_the_picture(steering):
    steering.take_pose(pose(1, -2, 3))
    (motion,) = steering.take()
    assert motion.engaged
    moved = motion.across_mm, motion.along_mm, motion.outwards_mm
    assert moved == pytest.approx((1, 2, 3))  # right; down, into the eye; out of the picture


def test_the_first_pose_moves_nothing():
    steering = PoseSteering(np.eye(3))
    steering.take_operator(pedal(1))
    steering.take_pose(pose(5, 5, 5))
    (motion,) = steering.take()
    assert motion.engaged and motion.across_mm == motion.along_mm == motion.outwards_mm == 0


def test_the_clutch_pedal_separates_hand_and_robot(steering):
    steering.take_clutch(pedal(1))
    for number in range(5):
        steering.take_pose(pose(number, 0, 0))
    assert not any(motion.engaged for motion in steering.take())
    steering.take_clutch(pedal(0))
    steering.take_pose(pose(5, 0, 0))
    assert sum(motion.across_mm for motion in steering.take()) == pytest.approx(1)


@pytest.mark.parametrize("value", [0, 2, -1])
def test_only_a_pressed_operator_switch_counts(steering, value):
    steering.take_operator(pedal(value))
    steering.take_pose(pose(1, 0, 0))
    assert not any(motion.engaged for motion in steering.take())


def test_a_switch_without_buttons_is_released(steering):
    steering.take_operator(Joy(Header(), [], []))
    steering.take_pose(pose(1, 0, 0))
    assert not any(motion.engaged for motion in steering.take())


def test_a_release_between_two_poses_is_not_missed(steering):
    steering.take_operator(pedal(0))
    steering.take_operator(pedal(1))
    assert [motion.engaged for motion in steering.take()] == [False]


@given(st.lists(st.tuples(*[st.floats(allow_nan=True, allow_infinity=True)] * 3), max_size=8))
def test_no_pose_moves_the_hand_far(positions):
    steering = PoseSteering(arm_rotation("20,-70,110", ""))
    steering.take_operator(pedal(1))
    refused = 0
    for at_mm in positions:
        try:
            steering.take_pose(pose(*at_mm))
        except ValueError:
            refused += 1
    motions = steering.take()
    assert len(motions) == len(positions)
    assert sum(not motion.engaged for motion in motions) == refused
    for motion in motions:
        moved_mm = math.hypot(motion.along_mm, motion.across_mm, motion.outwards_mm)
        assert moved_mm <= MAX_JUMP_MM * (1 + 1e-9)


@pytest.mark.parametrize(
    ("angles", "seen"),
    [("0,0,0", (1, 2, 3)), ("0,0,90", (-2, 1, 3)), ("90,0,0", (1, -3, 2)), ("0,180,0", (-1, 2, -3))],
)
def test_an_arm_with_other_axes_is_rotated(angles, seen):
    assert arm_rotation(angles, "") @ (1, 2, 3) == pytest.approx(seen)


@pytest.mark.parametrize(
    ("argument", "sentence"),
    [
        ("", "needs the arm's namespace, for example crtk:MTML"),
        ("MTML?rotated=1", "unknown option 'rotated'; did you mean 'rotate'?"),
        ("MTML?rotate=1,2", "rotate=1,2: expected three angles in degrees"),
        ("MTML?rotate=nan,0,0", "expected three angles in degrees"),
        ("MTML?clutch=my pedal", "is no ROS topic"),
    ],
)
def test_an_invalid_argument_is_refused(argument, sentence, ros_network):
    with pytest.raises(BadInput) as refusal:
        CrtkLeader(argument, VirtualClock())
    assert sentence in str(refusal.value)


def test_a_pedal_that_was_pressed_before_the_start_is_known_if_its_publisher_latches(peer):
    from cyclonedds.pub import DataWriter
    from cyclonedds.topic import Topic

    participant = peer.node.participant
    topic = Topic(participant, "rt/footpedals/clutch", Joy)
    writer = DataWriter(participant, topic, qos=Profile(1, is_transient_local=True).qos)
    writer.write(pedal(1))
    leader = CrtkLeader("MTML", VirtualClock())
    until(lambda: leader._steering._is_clutched, "the pedal is not known")
    writer.write(pedal(0))
    until(lambda: not leader._steering._is_clutched, "the release did not arrive")
    leader.close()
