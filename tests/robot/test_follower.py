import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.robot.follower import Follower
from haptigraph.robot.limits import CommandCheck
from haptigraph.robot.pose import ToolPose, Transform, angle_deg
from haptigraph.robot.rcm import direction_of, turned
from haptigraph.robot.setup import EyePlace, MotionLimits, RcmPlace, RobotSetup
from haptigraph.robot.simulated import EXAMPLE_SETUP
from haptigraph.teleop.mapping import ToolMotion

CYCLE_S = 0.005
LIMITS = MotionLimits()
EYE_IN_BASE = EXAMPLE_SETUP.eye.robot_from_eye
STEP_MM = st.floats(-3, 3)
MOTIONS = st.builds(ToolMotion, STEP_MM, STEP_MM, STEP_MM, st.just(0.0))
SMALL = st.builds(ToolMotion, *3 * [st.floats(-0.04, 0.04)], st.just(0.0))


def follower(**limits) -> Follower:
    return Follower(replace(EXAMPLE_SETUP, limits=MotionLimits(**limits)))


def at(depth_mm: float, tilt_deg: float = 0.0, azimuth_deg: float = 0.0) -> ToolPose:
    """A pose through the RCM, at an angle to the line to the eye's centre."""
    one = follower()
    across, outwards = one.directions(one.inwards)
    azimuth = math.radians(azimuth_deg)
    aside = math.cos(azimuth) * across + math.sin(azimuth) * outwards
    return one.rcm.pose(depth_mm, turned(one.inwards, aside, math.radians(tilt_deg)), ToolPose((0, 0, 0)))


POSES = st.builds(at, st.floats(-11, 23), st.floats(0, 49), st.floats(0, 360))


def in_eye(pose: ToolPose) -> ToolPose:
    return EYE_IN_BASE.inverse().pose(pose)


def tip_moved_mm(before: ToolPose, after: ToolPose) -> np.ndarray:
    """Return the displacement of the tip in the eye frame."""
    return np.subtract(in_eye(after).position_mm, in_eye(before).position_mm)


@given(POSES, st.lists(MOTIONS, max_size=20))
def test_the_commanded_shaft_passes_through_the_rcm_for_any_displacement(pose, motions):
    one = follower()
    for motion in motions:
        pose = one.next(pose, motion, CYCLE_S)
        assert one.rcm.distance_mm(pose) < 1e-9


@given(POSES, MOTIONS)
def test_the_limits_of_depth_tilt_and_speed_hold_for_any_displacement(pose, motion):
    one = follower()
    after = one.next(pose, motion, CYCLE_S)
    assert LIMITS.depth_min_mm - 1e-9 <= one.rcm.depth_mm(after) <= LIMITS.depth_max_mm + 1e-9
    assert one.tilt_deg(one.rcm.direction(after)) <= LIMITS.tilt_max_deg + 1e-6
    assert math.dist(pose.position_mm, after.position_mm) <= LIMITS.speed_mm_s * CYCLE_S * 1.0001
    assert angle_deg(pose, after) <= LIMITS.turn_deg_s * CYCLE_S * 1.0001
    assert CommandCheck(one.rcm, LIMITS, one.inwards).allows(pose, after, CYCLE_S)


def test_small_displacements_are_executed_in_the_directions_of_the_eye_frame():
    pose = at(15.0)
    one = follower()
    along = EYE_IN_BASE.rotation.T @ one.rcm.direction(pose)
    right = np.array((-along[1], along[0], 0.0))  # the shaft in the section, rotated by +90 degrees
    for motion, expected in [
        (ToolMotion(0.02, 0, 0, 0), 0.02 * along),
        (ToolMotion(0, 0.02, 0, 0), 0.02 * right),
        (ToolMotion(0, 0, 0.02, 0), np.array((0, 0, 0.02))),
    ]:
        assert tip_moved_mm(pose, one.next(pose, motion, CYCLE_S)) == pytest.approx(expected, abs=1e-4)


@given(POSES, st.floats(0.001, 0.04))
def test_right_is_right_and_out_is_out_on_both_sides_of_the_rcm(pose, size_mm):
    one = follower(tilt_max_deg=90)
    across, outwards = one.directions(one.rcm.direction(pose))
    for name, wanted in (("across_mm", across), ("outwards_mm", outwards)):
        motion = ToolMotion(0, 0, 0, 0)._replace(**{name: size_mm})
        moved_mm = np.subtract(one.next(pose, motion, CYCLE_S).position_mm, pose.position_mm) @ wanted
        assert -1e-12 <= moved_mm <= size_mm + 1e-9


@given(st.floats(-11, 23), st.floats(0, 49), st.floats(0, 360), st.lists(SMALL, max_size=10))
def test_a_hand_mirrored_at_the_section_moves_the_tip_to_the_mirrored_place(depth, tilt, azimuth, motions):
    """The example's RCM is in the section, so the setup is its own mirror image."""
    one, other = follower(), follower()
    pose, mirrored = at(depth, tilt, azimuth), at(depth, tilt, -azimuth)
    for motion in motions:
        pose = one.next(pose, motion, CYCLE_S)
        mirrored = other.next(mirrored, motion._replace(outwards_mm=-motion.outwards_mm), CYCLE_S)
    x, y, z = in_eye(pose).position_mm
    assert in_eye(mirrored).position_mm == pytest.approx((x, y, -z), abs=1e-6)


@given(POSES, st.lists(SMALL, min_size=1, max_size=10))
def test_motion_there_and_back_leaves_no_rotation_about_the_shaft(pose, motions):
    one = follower(turn_deg_s=360)
    path = [pose]
    for motion in motions:
        path.append(one.next(path[-1], motion, CYCLE_S))
    back = path[-1]
    for before in reversed(path[:-1]):
        back = one.rcm.pose(10.0, one.rcm.direction(before), back)
    assert angle_deg(back, pose) < 1e-5


@pytest.mark.parametrize("sign", [1, -1])
def test_nothing_winds_up_at_a_limit(sign):
    pose, one = at(10.0), follower()
    for _ in range(2000):
        pose = one.next(pose, ToolMotion(sign * 3.0, 0.0, 0.0, 0.0), CYCLE_S)
    depth_mm = one.rcm.depth_mm(pose)
    assert depth_mm == pytest.approx(LIMITS.depth_max_mm if sign > 0 else LIMITS.depth_min_mm)
    back = one.next(pose, ToolMotion(-sign * 0.02, 0.0, 0.0, 0.0), CYCLE_S)
    assert one.rcm.depth_mm(back) == pytest.approx(depth_mm - sign * 0.02)


def test_at_the_largest_tilt_the_shaft_slides_along_the_cone():
    one, pose = follower(), at(15.0, 49.99)
    for _ in range(400):
        pose = one.next(pose, ToolMotion(0.0, 0.02, 0.02, 0.0), CYCLE_S)
    assert one.tilt_deg(one.rcm.direction(pose)) == pytest.approx(LIMITS.tilt_max_deg, abs=1e-6)
    assert in_eye(pose).position_mm[2] > 3.0


@given(st.floats(24.5, 40), MOTIONS)
def test_from_outside_the_limits_it_only_moves_back(depth_mm, motion):
    one = follower()
    after = one.next(at(depth_mm), motion, CYCLE_S)
    assert one.rcm.depth_mm(after) <= depth_mm + 1e-9


def test_a_shaft_that_starts_beside_the_rcm_does_not_jump_and_comes_into_it():
    one, exact = follower(), at(12.0)
    across, _ = one.directions(one.rcm.direction(exact))
    pose = ToolPose(tuple((np.array(exact.position_mm) + 0.08 * across).tolist()), exact.quaternion)
    one.start(pose)
    assert one.next(pose, ToolMotion(0, 0, 0, 0), CYCLE_S).position_mm == pytest.approx(
        pose.position_mm, abs=1e-9
    )
    missed = [one.rcm.distance_mm(pose)]
    for _ in range(60):
        after = one.next(pose, ToolMotion(-0.02, 0.0, 0.0, 0.0), CYCLE_S)
        assert math.dist(pose.position_mm, after.position_mm) < 0.03
        pose = after
        missed.append(one.rcm.distance_mm(pose))
    assert all(after < before + 1e-9 for before, after in pairwise(missed))
    assert missed[0] == pytest.approx(0.08) and missed[-1] < 1e-9


def test_near_the_cameras_axis_right_is_the_eyes_x():
    setup = RobotSetup(RcmPlace((0.0, 0.0, 12.0)), eye=EyePlace((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)))
    across, outwards = Follower(setup).directions(np.array((0.0, 0.0, -1.0)))
    assert across == pytest.approx(np.array((1.0, 0.0, 0.0)))
    assert outwards == pytest.approx(np.array((0.0, -1.0, 0.0)))


@pytest.mark.parametrize(
    "setup, problem",
    [
        (replace(EXAMPLE_SETUP, eye=None), r"no \[eye\]"),
        (replace(EXAMPLE_SETUP, rcm=RcmPlace((151.0, 0.0, 60.0))), "1.0 mm from the eye's centre"),
    ],
)
def test_without_directions_steering_is_refused(setup, problem):
    with pytest.raises(BadInput, match=problem):
        Follower(setup)


@pytest.mark.parametrize(
    "change",
    [
        lambda one, pose: ToolPose((math.nan, 0.0, 0.0), pose.quaternion),
        lambda one, pose: ToolPose(
            tuple(np.add(pose.position_mm, (0.0, 0.2, 0.0)).tolist()), pose.quaternion
        ),
        lambda one, pose: one.rcm.pose(10.1, one.rcm.direction(pose), pose),
        lambda one, pose: one.rcm.pose(10.0, direction_of(2.0, 90.0), pose),
    ],
)
def test_a_command_outside_the_limits_is_refused(change):
    one = follower()
    check, pose = CommandCheck(one.rcm, LIMITS, one.inwards), at(10.0)
    assert check.allows(pose, pose, CYCLE_S)
    assert not check.allows(pose, change(one, pose), CYCLE_S)


def test_a_command_deeper_or_more_tilted_than_the_limits_is_refused():
    one = follower()
    check, pose = CommandCheck(one.rcm, LIMITS, one.inwards), at(24.0)
    assert not check.allows(pose, one.rcm.pose(24.01, one.rcm.direction(pose), pose), CYCLE_S)
    assert check.allows(at(10.0, 49.9), at(10.0, 50.0), CYCLE_S)
    assert not check.allows(at(10.0, 49.95), at(10.0, 50.05), CYCLE_S)
    assert check.allows(at(10.0, 52.05), at(10.0, 52.0), CYCLE_S)


@given(st.floats(-20, 20), st.floats(-20, 20))
def test_the_setups_frames_do_not_matter_to_the_motion(x, y):
    """Another place of robot and eye, the same motion in the eye."""
    moved = Transform(np.eye(3), np.array((x, y, 5.0)))
    setup = RobotSetup(
        RcmPlace(tuple(moved.point_mm(EXAMPLE_SETUP.rcm.at_mm).tolist())),
        eye=EyePlace(
            tuple(moved.point_mm(EXAMPLE_SETUP.eye.translation_mm).tolist()), EXAMPLE_SETUP.eye.quaternion
        ),
    )
    motion = ToolMotion(0.01, 0.02, -0.01, 0.0)
    here = follower().next(at(10.0), motion, CYCLE_S)
    there = Follower(setup).next(moved.pose(at(10.0)), motion, CYCLE_S)
    assert there.position_mm == pytest.approx(moved.point_mm(here.position_mm), abs=1e-9)
