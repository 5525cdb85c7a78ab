"""A volume averaged along rows and columns, with the brightness of its noise."""

from typing import NamedTuple

import cv2
import numpy as np

from haptigraph.imaging import FloatImage, Floats
from haptigraph.messages import Image
from haptigraph.perception.volume.scale import VolumeScale

__all__ = ["Cells", "downsampled"]

CELL_MM, ROW_MM = 0.04, 0.006  # lateral and axial size of the downsampled voxels, at least
DARK_SHARE = 0.06  # of the volume that is certainly without backscatter
NEIGHBOURS = 0.954  # median absolute difference of two standard normal variables


class Cells(NamedTuple):
    """A volume downsampled along rows and columns."""

    grey: FloatImage
    """(rows, slices, cells)."""
    scale: VolumeScale
    """Of the downsampled volume; its centre is that of the volume to within a cell."""
    x_mm: Floats
    """Positions of the cells, eye frame, (cells,)."""
    first_row_mm: float
    """Height of the middle of the first row, eye frame."""
    dark_grey: float
    """Grey value without backscatter."""
    sd_grey: float
    """Standard deviation of the noise of one downsampled voxel."""

    def height_mm(self, row: Floats) -> Floats:
        """Return the height of downsampled rows, eye frame."""
        return self.first_row_mm - row * self.scale.axial_mm


def downsampled(volume: Image, scale: VolumeScale) -> Cells:
    """Average voxels along rows and columns, not across slices.

    Args:
        volume: (h, n, w) grey.
        scale: Its size and scale.
    """
    height, slices, width = volume.shape
    across, down = max(1, round(CELL_MM / scale.lateral_mm)), max(1, round(ROW_MM / scale.axial_mm))
    cells, rows = width // across, height // down
    cut = np.ascontiguousarray(volume[: rows * down, :, : cells * across])
    flat = cut.reshape(rows * down, slices * cells * across)
    small = cv2.resize(flat, (slices * cells, rows), interpolation=cv2.INTER_AREA)
    grey = small.astype(np.float32).reshape(rows, slices, cells)
    blocks = cv2.resize(
        small, (max(slices * cells // 6, 1), max(rows // 12, 1)), interpolation=cv2.INTER_AREA
    )
    dark_grey = float(np.quantile(blocks, DARK_SHARE))
    some = flat[::16, : -across * 2 : 7].astype(np.int16) - flat[::16, across * 2 :: 7]
    fine_sd = max(float(np.median(np.abs(some))) / NEIGHBOURS, 1.0)
    return Cells(
        grey,
        VolumeScale(rows, slices, cells, scale.axial_mm * down, scale.slice_mm, scale.lateral_mm * across),
        scale.x_mm[0] + (np.arange(float(cells)) * across + (across - 1) / 2) * scale.lateral_mm,
        float(scale.y_mm(np.array((down - 1) / 2))),
        dark_grey,
        fine_sd,
    )
