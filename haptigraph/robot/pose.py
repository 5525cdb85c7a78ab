"""Poses and rigid transforms in three dimensions, millimetres, unit quaternions in the order x, y, z, w.

A pose is that of the tool: its origin is the tip, and one of its axes runs along the shaft.
"""

import math
from typing import TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

__all__ = [
    "IDENTITY",
    "Floats",
    "Quaternion",
    "ToolPose",
    "Transform",
    "Vec3",
    "angle_deg",
    "at_times",
    "composed",
    "quaternion_of",
    "rotated",
    "rotation_of",
]

Floats: TypeAlias = NDArray[np.float64]
Vec3: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]
"""A rotation as x, y, z, w, of length 1."""


class ToolPose(Struct, frozen=True):
    """Pose of a tool in a frame that the context names: the robot's base or the eye frame."""

    position_mm: Vec3
    """The tip."""
    quaternion: Quaternion = (0.0, 0.0, 0.0, 1.0)
    """From the tool's frame to that frame."""

    def axis(self, shaft_axis: Vec3) -> Floats:
        """Return the direction of the shaft, from handle to tip, (3,).

        Args:
            shaft_axis: That direction in the tool's frame.
        """
        return np.array(rotated(self.quaternion, shaft_axis))

    @property
    def is_finite(self) -> bool:
        """Whether every number is finite and the quaternion is a rotation."""
        numbers = (*self.position_mm, *self.quaternion)
        return all(map(math.isfinite, numbers)) and abs(math.hypot(*self.quaternion) - 1.0) < 1e-3


class Transform:
    """A rigid transform, frame to frame: rotation, then translation.

    Args:
        rotation: Orthonormal, right-handed, (3, 3).
        translation_mm: (3,).
    """

    def __init__(self, rotation: Floats, translation_mm: Floats) -> None:
        self.rotation, self.translation_mm = rotation, translation_mm

    @classmethod
    def of(cls, pose: ToolPose) -> "Transform":
        """Return the transform from a tool's frame to the frame of its pose."""
        return cls(rotation_of(pose.quaternion), np.array(pose.position_mm, dtype=np.float64))

    def point_mm(self, point_mm: Vec3 | Floats) -> Floats:
        """Transform one point (3,) or many (n, 3)."""
        moved: Floats = np.asarray(point_mm, dtype=np.float64) @ self.rotation.T + self.translation_mm
        return moved

    def pose(self, pose: ToolPose) -> ToolPose:
        """Transform a pose."""
        return (self @ Transform.of(pose)).as_pose()

    def inverse(self) -> "Transform":
        """Return the transform in the other direction."""
        return Transform(self.rotation.T, -self.rotation.T @ self.translation_mm)

    def as_pose(self) -> ToolPose:
        """Return it as the pose of the one frame in the other."""
        x, y, z = self.translation_mm.tolist()
        return ToolPose((x, y, z), quaternion_of(self.rotation))

    def __matmul__(self, first: "Transform") -> "Transform":
        """Return the transform that applies `first`, then this one."""
        return Transform(self.rotation @ first.rotation, self.point_mm(first.translation_mm))


IDENTITY = Transform(np.eye(3), np.zeros(3))


def rotation_of(quaternion: Quaternion) -> Floats:
    """Return the rotation matrix of a quaternion of any length but 0, (3, 3)."""
    length = math.hypot(*quaternion)
    x, y, z, w = (each / length for each in quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def rotated(quaternion: Quaternion, vector: Vec3) -> Vec3:
    """Return a vector rotated by a quaternion of any length but 0."""
    (x, y, z, w), (a, b, c) = quaternion, vector
    scale = 2.0 / (x * x + y * y + z * z + w * w)
    i, j, k = y * c - z * b, z * a - x * c, x * b - y * a
    return (
        a + scale * (w * i + y * k - z * j),
        b + scale * (w * j + z * i - x * k),
        c + scale * (w * k + x * j - y * i),
    )


def composed(after: Quaternion, first: Quaternion) -> Quaternion:
    """Return the rotation, of length 1, that applies `first`, then `after`."""
    (x, y, z, w), (a, b, c, d) = after, first
    i = w * a + x * d + y * c - z * b
    j = w * b - x * c + y * d + z * a
    k = w * c + x * b - y * a + z * d
    s = w * d - x * a - y * b - z * c
    length = math.sqrt(i * i + j * j + k * k + s * s)
    return i / length, j / length, k / length, s / length


def quaternion_of(rotation: Floats) -> Quaternion:
    """Return the unit quaternion of a rotation matrix (3, 3), with w >= 0.

    Of the four ways to compute it, the one that divides by the largest number (Shepperd 1978, J. Guidance and
    Control 1(3)).
    """
    m = rotation
    squares = np.array([m[0, 0], m[1, 1], m[2, 2], np.trace(m)])
    largest = int(squares.argmax())
    if largest == 3:
        q = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], 1 + squares[3]])
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q = np.empty(4)
        q[i] = 1 + m[i, i] - m[j, j] - m[k, k]
        q[j], q[k], q[3] = m[i, j] + m[j, i], m[i, k] + m[k, i], m[k, j] - m[j, k]
    q *= math.copysign(1.0, q[3]) / np.linalg.norm(q)
    x, y, z, w = q.tolist()
    return x, y, z, w


def angle_deg(one: ToolPose, other: ToolPose) -> float:
    """Return the angle of the rotation between two poses [deg], 0 to 180; accurate for small angles."""
    (x, y, z, w), (a, b, c, d) = one.quaternion, other.quaternion
    i = w * a - x * d - y * c + z * b  # the conjugate of the one times the other
    j = w * b - y * d - z * a + x * c
    k = w * c - z * d - x * b + y * a
    return math.degrees(2 * math.atan2(math.hypot(i, j, k), abs(w * d + x * a + y * b + z * c)))


def at_times(times_s: Floats, values: Floats, at_s: Floats) -> Floats:
    """Return values (n, m), interpolated at other times (k,), as (k, m)."""
    return np.column_stack([np.interp(at_s, times_s, column) for column in values.T])
