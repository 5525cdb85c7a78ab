"""Rotations in space: rotation vectors, Euler angles, the mean of several rotations."""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Array",
    "euler_xyz_matrix",
    "mean_rotation",
    "nearest_rotation",
    "rotation_matrix",
    "rotation_vector",
]

Array = NDArray[np.floating[Any]]

SMALL_RAD = 1e-9


def rotation_matrix(vector_rad: Array) -> Array:
    """Return the matrix of a rotation vector (Rodrigues' formula)."""
    angle = float(np.linalg.norm(vector_rad))
    if angle < SMALL_RAD:
        return np.asarray(np.eye(3) + _cross_matrix(vector_rad))
    k = _cross_matrix(vector_rad / angle)
    return np.asarray(np.eye(3) + np.sin(angle) * k + (1 - np.cos(angle)) * (k @ k))


def rotation_vector(matrix: Array) -> Array:
    """Return the rotation vector [rad] of a matrix; its angle is less than 180 degrees."""
    skew = np.array([matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]])
    sine, cosine = float(np.linalg.norm(skew)) / 2, (float(np.trace(matrix)) - 1) / 2
    if sine < SMALL_RAD:
        return np.asarray(skew / 2)
    return np.asarray(skew / (2 * sine) * np.arctan2(sine, cosine))


def euler_xyz_matrix(angles_deg: Array) -> Array:
    """Return the matrix Rx Ry Rz of intrinsic Euler angles."""
    x, y, z = np.deg2rad(angles_deg)
    axes = np.eye(3)
    return rotation_matrix(x * axes[0]) @ rotation_matrix(y * axes[1]) @ rotation_matrix(z * axes[2])


def nearest_rotation(matrix: Array) -> Array:
    """Return the rotation that is nearest to a matrix, by Frobenius' norm."""
    u, _, v = np.linalg.svd(matrix)
    u[:, -1] *= np.sign(np.linalg.det(u @ v))
    rotation: Array = u @ v
    return rotation


def mean_rotation(matrices: Iterable[Array]) -> Array:
    """Return the chordal mean of rotations."""
    return nearest_rotation(np.mean(list(matrices), axis=0))


def _cross_matrix(v: Array) -> Array:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
