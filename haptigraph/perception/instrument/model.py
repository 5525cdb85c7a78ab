"""The model of an instrument in volumes, and the pose that a registration reports.

Positions are in the eye frame [mm]: the origin at the volume's centre, x along the columns, y up against the
beam, z along the slices. In the instrument's own frame the tip is the origin, and the axes are parallel to
those of the eye at the mean orientation of the volumes that the model was learned from.
"""

from functools import cached_property

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.perception.instrument.rotations import Array
from haptigraph.perception.native.volume import ROWS_PER_CELL, Template

__all__ = ["VOXEL_MM", "InstrumentModel", "InstrumentPose", "VoxelMm", "cell_affine", "rigid_template"]

VoxelMm = tuple[float, float, float]
"""Size of a voxel along rows, slices and columns."""
VOXEL_MM: VoxelMm = (0.0058, 0.079, 0.051)
"""Of the 3DOCT 6DoF Pose Dataset (Laves et al., MIDL 2020), from its labels; `--voxel-mm` if not given."""


class InstrumentModel(Struct, frozen=True, eq=False, dict=True):
    """What a registration needs to know of an instrument and of the scanner that sees it."""

    voxel_mm: VoxelMm
    is_usable: NDArray[np.bool_]
    """Rows without a fixed reflection, (rows,)."""
    points_mm: NDArray[np.float32]
    """Of the template, in the instrument's frame, (n, 3)."""
    values: NDArray[np.float32]
    """Mean of the registered reduced volumes there, (n,)."""
    gradients: NDArray[np.float32]
    """Its derivatives by position [1/mm], (n, 3)."""
    axis: Array
    """Unit vector along the shaft towards the tip, in the instrument's frame."""
    bevel: Array
    """Unit vector across the shaft, from its axis to the side on which the tip lies."""
    start_mm: Array
    """Where a first estimate puts the tip, in the instrument's frame: its mean error."""
    level: float
    """Foreground in reduced volumes is brighter."""
    cost_limit: float
    """A registration of a greater cost per point is refused."""
    tip_sd_mm: Array
    """Standard deviation of a registered tip along x, y and z."""
    axis_sd_deg: float
    """Standard deviation of the angle between a registered axis and the true one, per direction."""
    roll_sd_deg: float
    """Standard deviation of a registered roll."""
    volumes: int
    """That it was learned from."""

    @cached_property
    def template(self) -> Template:
        """Return the template as C has it, with derivatives by shift and rotation of the instrument."""
        return rigid_template(self.points_mm, self.values, self.gradients)

    @property
    def rows(self) -> int:
        """Return how many rows its volumes have."""
        return len(self.is_usable)


class InstrumentPose(Struct, frozen=True, eq=False):
    """Where an instrument is in a volume; standard deviations are those of the registration."""

    tip_mm: Array
    """In the eye frame, (3,)."""
    axis: Array
    """Unit vector along the shaft towards the tip, (3,)."""
    bevel: Array
    """Unit vector across the shaft, to the side on which the tip lies, (3,)."""
    rotation: Array
    """From the instrument's frame to the eye frame, (3, 3)."""
    roll_deg: float
    """About the axis, from the mean of the volumes that the model was learned from."""
    tip_sd_mm: Array
    """Along x, y and z."""
    axis_sd_deg: float
    """Of the axis, per direction."""
    roll_sd_deg: float
    cost: float
    """Mean squared residual of the registration, with Huber's weights; see `InstrumentModel.cost_limit`."""


def rigid_template(
    points_mm: NDArray[np.float32], values: NDArray[np.float32], gradients: NDArray[np.float32]
) -> Template:
    """Return a template with its derivatives by shift [1/mm] and by rotation about the origin [1/rad]."""
    jacobian = np.concatenate([gradients, np.cross(points_mm, gradients)], axis=1)
    return Template(points_mm, values, np.ascontiguousarray(jacobian, np.float32))


def cell_affine(
    rotation: Array, tip_mm: Array, rows: int, shape: tuple[int, ...], voxel_mm: VoxelMm
) -> NDArray[np.float64]:
    """Return the map (3, 4) from a point of the instrument to column, cell and slice of a reduced volume.

    Args:
        rotation: From the instrument's frame to the eye frame.
        tip_mm: Origin of the instrument's frame in the eye frame.
        rows: Of the volume before its reduction.
        shape: Of the reduced volume: columns, slices, cells.
        voxel_mm: Of the volume before its reduction.
    """
    axial_mm, slice_mm, column_mm = voxel_mm
    per_mm = np.array([1 / column_mm, -1 / (axial_mm * ROWS_PER_CELL), 1 / slice_mm])
    first_row = (ROWS_PER_CELL - 1) / 2  # of a cell's centre
    centre = np.array([(shape[0] - 1) / 2, ((rows - 1) / 2 - first_row) / ROWS_PER_CELL, (shape[1] - 1) / 2])
    return np.column_stack([per_mm[:, None] * rotation, per_mm * tip_mm + centre])
