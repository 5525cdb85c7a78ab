"""Size and scale of a volume, and the mapping from voxels to the eye frame."""

from typing import NamedTuple

import numpy as np

from haptigraph.imaging import Floats

__all__ = ["VolumeScale"]


class VolumeScale(NamedTuple):
    """Size and scale of a volume, (rows, slices, columns)."""

    rows: int
    slices: int
    columns: int
    axial_mm: float
    slice_mm: float
    lateral_mm: float

    @property
    def voxel_mm(self) -> tuple[float, float, float]:
        """Size of a voxel along rows, slices and columns."""
        return self.axial_mm, self.slice_mm, self.lateral_mm

    @property
    def shape(self) -> tuple[int, int, int]:
        """Axial rows, slices, lateral columns."""
        return self.rows, self.slices, self.columns

    def y_mm(self, row: Floats) -> Floats:
        """Return the height of rows, eye frame."""
        return np.asarray(((self.rows - 1) / 2 - row) * self.axial_mm, np.float64)

    def row(self, y_mm: Floats) -> Floats:
        """Return the row of heights, sub-voxel."""
        return np.asarray((self.rows - 1) / 2 - y_mm / self.axial_mm, np.float64)

    @property
    def x_mm(self) -> Floats:
        """Positions of the columns, eye frame, (columns,)."""
        return (np.arange(float(self.columns)) - (self.columns - 1) / 2) * self.lateral_mm

    @property
    def z_mm(self) -> Floats:
        """Positions of the slices, eye frame, (slices,)."""
        return (np.arange(float(self.slices)) - (self.slices - 1) / 2) * self.slice_mm
