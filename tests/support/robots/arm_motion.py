"""A needle holder that pivots about a point, moved by hand: poses, velocities and joints over time, metres."""

import numpy as np

RCM_M = np.array([0.02, -0.03, 0.10])
DOWN = np.diag([1.0, -1.0, -1.0])  # the tool's z axis points down
JOINT_NAMES = ["tilt_x", "tilt_y", "roll", "insertion"]
NOISE_RAD = np.radians(0.02)
NOISE_M = 5e-6


def rotation_about(axis, angle_rad):
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = c
    matrix[i, j], matrix[j, i] = -s, s
    return matrix


def forward(joints):
    """The tip [m] and the rotation of the tool, for tilt x, tilt y, roll [rad] and insertion [m]."""
    tilt_x, tilt_y, roll, insertion_m = joints
    rotation = rotation_about(0, tilt_x) @ rotation_about(1, tilt_y) @ DOWN @ rotation_about(2, roll)
    return RCM_M + insertion_m * rotation[:, 2], rotation


def by_hand(time_s):
    """Joints of an arm that somebody moves in every direction."""
    return np.array(
        [
            np.radians(25) * np.sin(1.1 * time_s),
            np.radians(20) * np.sin(1.7 * time_s + 1),
            np.radians(35) * np.sin(0.9 * time_s),
            -0.008 + 0.022 * np.sin(1.3 * time_s),
        ]
    )


def noisy(joints, rng):
    """Joints as encoders measure them."""
    return joints + rng.normal(0, [NOISE_RAD] * 3 + [NOISE_M])


def twist(joints_at, time_s, step_s=1e-4):
    """Velocity [m/s] and angular velocity [rad/s] of the tip in the base."""
    before, after = forward(joints_at(time_s - step_s)), forward(joints_at(time_s + step_s))
    turned = (after[1] @ before[1].T - np.eye(3)) / (2 * step_s)
    return np.concatenate([(after[0] - before[0]) / (2 * step_s), [turned[2, 1], turned[0, 2], turned[1, 0]]])


def quaternion(rotation):
    """x, y, z, w; without care for half turns, of which an arm makes none beyond DOWN."""
    m = rotation
    q = np.array([1 + m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0], m[2, 1] - m[1, 2]])
    return q / np.linalg.norm(q)
