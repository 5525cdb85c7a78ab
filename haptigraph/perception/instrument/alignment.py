"""Rigid registration of a template to a reduced volume, by inverse compositional Gauss-Newton steps.

Baker and Matthews, Lucas-Kanade 20 years on, IJCV 56 (2004), with Huber's weights.
"""

import numpy as np
from msgspec import Struct

from haptigraph.imaging import Mask
from haptigraph.perception.instrument.model import VoxelMm, cell_affine
from haptigraph.perception.instrument.rotations import Array, nearest_rotation, rotation_matrix
from haptigraph.perception.native.volume import ReducedVolume, Template

__all__ = ["Alignment", "align"]

MAX_STEPS = 40
KNEE = 20.0
"""Residual from which on a cell counts less [levels of a reduced volume]."""
CONVERGED_MM = 2e-4
CONVERGED_RAD = 2e-4
SPARSE = 7
"""One of so many points is used until the first convergence."""
MAX_SHIFT_MM = 0.3
MAX_TURN_RAD = 0.1
"""Of a step; longer ones are shortened."""
DAMPING = 1e-6
"""Of the normal matrix's diagonal: an instrument may have no visible roll."""


class Alignment(Struct, frozen=True):
    """A registered pose."""

    rotation: Array
    """From the template's frame to the eye frame."""
    origin_mm: Array
    """Of the template's frame, in the eye frame."""
    cost: float
    """Mean squared residual per point, with Huber's weights."""
    inside: float
    """Share of the template's points that are inside the volume."""


def align(
    volume: ReducedVolume,
    template: Template,
    rows: int,
    voxel_mm: VoxelMm,
    rotation: Array,
    origin_mm: Array,
    is_used: Mask | None = None,
) -> Alignment:
    """Register a template.

    Args:
        volume: The reduced volume.
        template: Values and derivatives by shift and rotation.
        rows: Of the volume before its reduction.
        voxel_mm: Of the volume before its reduction.
        rotation: Where to start: from the template's frame to the eye frame.
        origin_mm: Where to start: the template's origin in the eye frame.
        is_used: Points of the template that count; None: all.
    """
    used = np.ones(template.count, np.bool_) if is_used is None else is_used
    sparse = np.zeros(template.count, np.bool_)
    sparse[::SPARSE] = used[::SPARSE]
    near = _iterate(volume, template, rows, voxel_mm, Alignment(rotation, origin_mm, np.inf, 0.0), sparse)
    return _iterate(volume, template, rows, voxel_mm, near, used)


def _iterate(
    volume: ReducedVolume, template: Template, rows: int, voxel_mm: VoxelMm, start: Alignment, used: Mask
) -> Alignment:
    rotation, origin_mm = start.rotation, start.origin_mm
    for _ in range(MAX_STEPS):
        affine = cell_affine(rotation, origin_mm, rows, volume.cells.shape, voxel_mm)
        cost, inside, gradient, normal = volume.compare(template, affine, used, KNEE)
        damped = normal + np.diag(DAMPING * normal.diagonal().max() + DAMPING * normal.diagonal() + 1e-12)
        step = np.linalg.solve(damped, gradient)
        step[:3] *= min(1.0, MAX_SHIFT_MM / max(float(np.linalg.norm(step[:3])), 1e-12))
        step[3:] *= min(1.0, MAX_TURN_RAD / max(float(np.linalg.norm(step[3:])), 1e-12))
        rotation = np.asarray(rotation @ rotation_matrix(step[3:]).T)
        origin_mm = origin_mm - rotation @ step[:3]
        if np.abs(step[:3]).max() < CONVERGED_MM and np.abs(step[3:]).max() < CONVERGED_RAD:
            break
    return Alignment(nearest_rotation(rotation), origin_mm, cost, inside / max(int(used.sum()), 1))
