"""The mean of registered volumes on a regular grid, and the template that is taken from it."""

from collections.abc import Iterable, Sequence
from functools import cached_property

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.imaging import Mask
from haptigraph.perception.instrument.alignment import Alignment
from haptigraph.perception.instrument.model import VoxelMm, cell_affine, rigid_template
from haptigraph.perception.instrument.rotations import Array
from haptigraph.perception.native.volume import ROWS_PER_CELL, ReducedVolume, Template

__all__ = ["MeanGrid", "RawTemplate"]

GRID_SHARE = np.array([0.88, 1.0, 0.76])
"""Of the size of a cell along x, y and z that the grid's spacing is."""
MARGIN_MM = 0.3
"""Of the grid about the instrument."""
KERNEL = np.array([0.1065, 0.787, 0.1065])
"""A Gaussian of half a grid step: the mean of a hundred volumes is still noisy."""
MIN_COUNT_SHARE = 0.6
"""Of the volumes that must show a point."""
EDGE_SHARE = 0.1
"""Of the foreground's level over the background from which a point belongs to the instrument."""
DILATION = 3
"""Grid steps around the instrument that the template includes."""
TIP_MM = 0.1
"""From the template's end: what lies there is averaged to the tip."""
BEVEL_SHARE = 0.4
"""Of the visible length, from the tip, that may be bevelled."""
MIN_BEVEL_MM = 0.02


class RawTemplate(Struct, frozen=True, eq=False, dict=True):
    """Points of the mean volume in and about the instrument, in the frame of the grid."""

    points_mm: NDArray[np.float32]
    values: NDArray[np.float32]
    gradients: NDArray[np.float32]

    @cached_property
    def template(self) -> Template:
        """Return it as C has it, with derivatives by shift and rotation."""
        return rigid_template(self.points_mm, self.values, self.gradients)

    def tip_axis_bevel(self, level: float) -> tuple[Array, Array, Array]:
        """Return the tip, the axis towards it, and the direction from the axis to the side of the tip.

        Along a shaft nothing changes: its axis is the direction of the least squared derivatives, away from
        the bevel. The tip is where the foreground ends, at the end that is nearer to the grid's origin.
        """
        is_bright = self.values > level / 2
        points = self.points_mm[is_bright].astype(np.float64)
        weights = self.values[is_bright].astype(np.float64)
        centre = np.average(points, axis=0, weights=weights)
        axis: Array = np.linalg.svd((points - centre) * np.sqrt(weights)[:, None], full_matrices=False)[2][0]
        axis = axis * (1.0 if axis @ -centre >= 0 else -1.0)
        is_shaft = _is_behind(self.points_mm @ axis)
        gradients = self.gradients[is_shaft].astype(np.float64)
        least = np.linalg.eigh(gradients.T @ gradients)[1][:, 0]
        axis = least * (1.0 if least @ axis >= 0 else -1.0)
        along = points @ axis
        is_end = along > along.max() - TIP_MM
        tip = np.average(points[is_end], axis=0, weights=weights[is_end])
        tip += axis * (along.max() - tip @ axis)
        is_behind = _is_behind(along)
        aside = tip - np.average(points[is_behind], axis=0, weights=weights[is_behind])
        aside -= axis * (aside @ axis)
        if np.linalg.norm(aside) < MIN_BEVEL_MM:
            aside = np.linalg.svd(axis[None])[2][1]
        return tip, axis, aside / np.linalg.norm(aside)


def _is_behind(along_mm: Array) -> Mask:
    """Return which points are far from the end."""
    return np.asarray(along_mm < along_mm.max() - BEVEL_SHARE * np.ptp(along_mm))


class MeanGrid(Struct, frozen=True, eq=False):
    """A grid in the instrument's frame, about one volume's foreground."""

    points_mm: NDArray[np.float32]
    """(n, 3)."""
    shape: tuple[int, int, int]
    spacing_mm: Array
    rows: int
    voxel_mm: VoxelMm
    level: float

    @classmethod
    def around(
        cls, volume: ReducedVolume, tip_mm: Array, rows: int, voxel_mm: VoxelMm, level: float
    ) -> "MeanGrid":
        """Return the grid about a volume's foreground, its origin at the tip."""
        cell_mm = np.array([voxel_mm[2], voxel_mm[0] * ROWS_PER_CELL, voxel_mm[1]])
        spacing = GRID_SHARE * cell_mm
        affine = cell_affine(np.eye(3), tip_mm, rows, volume.cells.shape, voxel_mm)
        columns, slices, cells = np.nonzero(volume.cells > level)
        indices = np.column_stack([columns, cells, slices])
        places = (indices - affine[:, 3]) / affine.diagonal()
        low, high = np.percentile(places, [1, 99], axis=0)
        low, high = np.minimum(low, 0) - MARGIN_MM, np.maximum(high, 0) + MARGIN_MM
        steps = [
            np.arange(int(np.floor(a / step)), int(np.ceil(b / step)) + 1) * step
            for a, b, step in zip(low, high, spacing, strict=True)
        ]
        points = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
        shape = len(steps[0]), len(steps[1]), len(steps[2])
        return cls(np.ascontiguousarray(points, np.float32), shape, spacing, rows, voxel_mm, level)

    def mean(self, volumes: Iterable[ReducedVolume], poses: Sequence[Alignment]) -> RawTemplate:
        """Return the template of registered volumes."""
        sums, counts = np.zeros(len(self.points_mm), np.float32), np.zeros(len(self.points_mm), np.float32)
        for volume, pose in zip(volumes, poses, strict=True):
            affine = cell_affine(pose.rotation, pose.origin_mm, self.rows, volume.cells.shape, self.voxel_mm)
            volume.add_samples(self.points_mm, affine, sums, counts)
        mean = np.asarray(sums / np.maximum(counts, 1), np.float32).reshape(self.shape)
        is_known = (counts >= max(1.0, MIN_COUNT_SHARE * len(poses))).reshape(self.shape)
        for axis in range(3):
            mean = _smoothed(mean, axis)
        gradients = np.stack(np.gradient(mean, *self.spacing_mm), axis=-1)
        background = float(np.median(mean[is_known]))
        is_near = _grown((mean > background + EDGE_SHARE * self.level) & is_known, DILATION)
        is_inner = ~_grown(~is_known, 1)
        chosen = (is_near & is_inner).ravel()
        return RawTemplate(
            self.points_mm[chosen],
            np.ascontiguousarray(mean.ravel()[chosen], np.float32),
            np.ascontiguousarray(gradients.reshape(-1, 3)[chosen], np.float32),
        )


def _smoothed(values: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    padded = np.pad(values, [(1, 1) if k == axis else (0, 0) for k in range(3)], mode="edge")
    size = values.shape[axis]
    parts = (np.take(padded, range(start, start + size), axis) for start in range(3))
    return np.asarray(sum(k * part for k, part in zip(KERNEL, parts, strict=True)), np.float32)


def _grown(mask: NDArray[np.bool_], steps: int) -> NDArray[np.bool_]:
    """Return a mask that includes the neighbours along each axis, so many times."""
    for _ in range(steps):
        grown = mask.copy()
        for axis in range(3):
            after, before = [slice(None)] * 3, [slice(None)] * 3
            after[axis], before[axis] = slice(1, None), slice(None, -1)
            grown[tuple(after)] |= mask[tuple(before)]
            grown[tuple(before)] |= mask[tuple(after)]
        mask = grown
    return mask
