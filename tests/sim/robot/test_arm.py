import numpy as np
import pytest

from haptigraph.sim.robot.arm import STEP_NS, Arm, ArmErrors

MS = 1_000_000
TIP_MM = np.array((10.0, -20.0, 30.0))
MOUNT = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
NONE = ArmErrors(0.0, 0.0)
AWAY_MM = np.array((1.0, -0.5, 0.25))


def about_x(angle_deg):
    sine, cosine = np.sin(np.radians(angle_deg)), np.cos(np.radians(angle_deg))
    return np.array([[1.0, 0.0, 0.0], [0.0, cosine, -sine], [0.0, sine, cosine]])


def test_it_goes_to_a_commanded_pose_after_its_latency():
    arm = Arm(TIP_MM, MOUNT, 1, NONE)
    arm.command(0, TIP_MM + AWAY_MM, MOUNT @ about_x(5.0))
    arm.advance(14 * MS)
    assert arm.pose.position_mm == pytest.approx(TIP_MM)
    arm.advance(300 * MS)
    assert arm.pose.position_mm == pytest.approx(TIP_MM + AWAY_MM, abs=1e-6)
    assert arm.pose.rotation == pytest.approx(MOUNT @ about_x(5.0), abs=1e-6)


def test_measurements_arrive_in_order_15_to_25_ms_late():
    arm = Arm(TIP_MM, MOUNT, 2)
    arm.advance(400 * MS)
    late_ms = [(arrived_ns - pose.stamp_ns) / MS for arrived_ns, pose in arm.arrived]
    stamps = [pose.stamp_ns for _, pose in arm.arrived]
    assert stamps == list(range(STEP_NS, STEP_NS * len(stamps) + 1, STEP_NS))
    assert 15 <= min(late_ms) < 17 and 23 < max(late_ms) <= 25
    assert len(stamps) >= 75


def test_rotations_are_in_error_by_the_stated_standard_deviation():
    true_deg, measured_deg = [], []
    for seed in range(300):
        arm = Arm(TIP_MM, MOUNT, seed)
        arm.advance(35 * MS)
        measured = arm.arrived[0][1].rotation
        true_deg.append(np.degrees((MOUNT.T @ arm.pose.rotation)[2, 1]))
        measured_deg.append(np.degrees((MOUNT.T @ measured)[2, 1]))
    assert np.std(true_deg) == pytest.approx(0.02, rel=0.15)
    assert np.std(measured_deg) == pytest.approx(0.02 * 2**0.5, rel=0.15)


def test_joints_stop_at_their_limits_and_have_a_largest_speed():
    arm = Arm(TIP_MM, MOUNT, 3, NONE)
    arm.command(0, TIP_MM + 500 * np.eye(3)[0], MOUNT)
    arm.advance(25 * MS)
    places = [arm.joints]
    for now_ms in range(30, 3000, 5):
        arm.advance(now_ms * MS)
        places.append(arm.joints)
    assert np.abs(np.diff(places, axis=0)).max() <= 50 * 0.005 + 1e-9
    assert np.abs(arm.joints).max() == pytest.approx(80.0)


def test_hold_keeps_it_where_it_is_however_often():
    arm = Arm(TIP_MM, MOUNT, 4, NONE)
    arm.command(0, TIP_MM + 20 * AWAY_MM, MOUNT)
    arm.advance(100 * MS)
    for now_ms in range(100, 400, 5):
        arm.hold(now_ms * MS)
        arm.advance(now_ms * MS)
        if now_ms == 130:
            place = arm.joints
    assert arm.joints == pytest.approx(place)
    assert np.abs(place).max() > 1.0
