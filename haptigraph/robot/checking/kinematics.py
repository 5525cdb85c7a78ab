"""Check that the poses of a robot move, by how much, and that joints move with them."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from haptigraph.findings import Finding
from haptigraph.robot.checking.messages import MAX_SPEED_M_S
from haptigraph.robot.checking.recorded import Recorded
from haptigraph.robot.checking.timing import stamps_are_usable
from haptigraph.robot.checking.velocities import WINDOW_S, turned_rad, velocity_findings
from haptigraph.robot.pose import Floats, at_times

__all__ = ["MIN_MOVED_MM", "MIN_TURNED_DEG", "kinematic_findings", "kinematic_measurements"]

MIN_MOVED_MM, MIN_TURNED_DEG = 5.0, 5.0
"""Motion by hand that a check needs: along every axis, and altogether."""
JUMP_SHARE = 0.02  # of the steps between poses that are faster than a hand
JOINT_RATIO = 15.0  # of joint speeds and angular velocity; in degrees it is about 57


def kinematic_findings(recorded: Recorded) -> Iterator[Finding]:
    """Yield the problems of motion. The recorded poses are finite, and of unit quaternions."""
    time_s, position_m, rotation = _poses(recorded)
    steps_m = np.linalg.norm(np.diff(position_m, axis=0), axis=1)
    speeds_m_s = steps_m / np.maximum(np.diff(time_s), 1e-3)
    if np.mean(speeds_m_s > MAX_SPEED_M_S) > JUMP_SHARE:
        yield Finding(
            "speed",
            f"poses move at {np.percentile(speeds_m_s, 99):.3g} m/s; at most {MAX_SPEED_M_S:g} m/s is valid "
            "for a robot that is moved by hand: are positions in metres, or do poses jump?",
        )
        return
    frozen = list(_frozen(recorded, time_s, position_m, rotation))
    yield from frozen
    if frozen:
        return
    moved_mm, turned_deg = _extents(position_m, rotation)
    if moved_mm.min() < MIN_MOVED_MM or turned_deg < MIN_TURNED_DEG:
        yield Finding(
            "not_moved",
            f"the tool was moved {moved_mm.max():.1f} mm, {moved_mm.min():.1f} mm along the least used "
            f"axis, and turned {turned_deg:.1f} deg, so axes and units were not exercised; it must be moved "
            f"by hand {MIN_MOVED_MM:g} mm along every axis, and turned {MIN_TURNED_DEG:g} deg about two",
        )
        return
    yield from _joint_units(recorded, time_s, rotation)
    if len(recorded.twists):
        yield from velocity_findings(recorded, time_s, position_m, rotation)


def kinematic_measurements(recorded: Recorded) -> dict[str, float]:
    """Return how far the tool was moved and turned."""
    _, position_m, rotation = _poses(recorded)
    moved_mm, turned_deg = _extents(position_m, rotation)
    return {
        "moved_most_mm": float(moved_mm.max()),
        "moved_least_mm": float(moved_mm.min()),
        "turned_deg": turned_deg,
    }


def _poses(recorded: Recorded) -> tuple[Floats, Floats, Rotation]:
    """Return times [s], positions [m] (n, 3) and rotations, each time once."""
    samples = recorded.poses.samples()
    stamp_s = samples.stamp_s if stamps_are_usable(recorded) else samples.received_s
    time_s, first = np.unique(stamp_s, return_index=True)
    numbers = samples.numbers[first]
    return time_s, numbers[:, :3], Rotation.from_quat(numbers[:, 3:])


def _extents(position_m: Floats, rotation: Rotation) -> tuple[Floats, float]:
    """Return the extents along the principal axes [mm] (3,), and the largest rotation [deg]."""
    centred_mm = 1e3 * (position_m - position_m.mean(axis=0))
    axes = np.linalg.svd(centred_mm, full_matrices=False)[2]
    turned_deg = float(np.degrees((rotation * rotation[0].inv()).magnitude().max()))
    extents_mm: Floats = np.ptp(centred_mm @ axes.T, axis=0)
    return extents_mm, turned_deg


def _frozen(recorded: Recorded, time_s: Floats, position_m: Floats, rotation: Rotation) -> Iterator[Finding]:
    same = (np.diff(position_m, axis=0) == 0).all(axis=1)
    same &= (np.diff(rotation.as_quat(), axis=0) == 0).all(axis=1)
    if same.all():
        yield Finding(
            "pose_frozen",
            f"all {len(position_m)} poses are identical; poses that follow the robot are valid: if it was "
            "not moved, move it by hand",
        )
        return
    longest_s = _longest_s(time_s, same)
    moving = _speed_m_s(recorded)
    if longest_s > 0.5 and moving is not None and moving > 0.002:
        yield Finding(
            "pose_frozen",
            f"the pose does not change for {longest_s:.2g} s while measured_cv reports motion; poses that "
            "follow the robot are valid",
        )


def _longest_s(time_s: Floats, same: "np.ndarray") -> float:
    longest_s, start_s = 0.0, time_s[0]
    for at_s, is_same in zip(time_s[1:], same, strict=True):
        if is_same:
            longest_s = max(longest_s, at_s - start_s)
        else:
            start_s = at_s
    return longest_s


def _speed_m_s(recorded: Recorded) -> float | None:
    if not len(recorded.twists):
        return None
    return float(np.median(np.linalg.norm(recorded.twists.samples().numbers[:, :3], axis=1)))


def _joint_units(recorded: Recorded, time_s: Floats, rotation: Rotation) -> Iterator[Finding]:
    """Compare how far joints and tool turn: the tool turns no further than all joints together."""
    samples = recorded.joints.samples()
    if len(samples.received_s) < 2 or not samples.numbers.size:
        return
    joint_s = samples.stamp_s if stamps_are_usable(recorded) else samples.received_s
    joint_s, first = np.unique(joint_s, return_index=True)
    edges_s = np.arange(max(time_s[0], joint_s[0]), min(time_s[-1], joint_s[-1]), WINDOW_S)
    joints = at_times(joint_s, samples.numbers[first], edges_s)
    angles_rad = np.linalg.norm(turned_rad(edges_s, time_s, rotation), axis=1)
    ratio = float(np.abs(np.diff(joints, axis=0)).sum() / angles_rad.sum())
    if ratio > JOINT_RATIO:
        yield Finding(
            "joint_units",
            f"joints turn {ratio:.3g} times as far as the tool; at most {JOINT_RATIO:g} times is valid: is "
            "measured_js in degrees, or in millimetres?",
        )
