"""A B-scan as the searches of `bscan` use it: at its resolution, downsampled, with its scale.

Turns an image (px) and its scale (mm per px) into cells of the same size in millimetres for every scanner, so
that each stage can state its lengths in millimetres. An oblique length is counted in steps of the geometric
mean of both scales, because the pixels of a B-scan are not square.
"""

import math
from typing import NamedTuple

import numpy as np

from haptigraph.messages import Image
from haptigraph.perception.native.bscan import GridLevels, ScanGrid, average_cells, sum_squares

__all__ = ["ScanImage", "ScanScale", "scan_image"]

LATERAL_MM, AXIAL_MM = 0.0234, 0.0099  # size of a cell
COLUMN_MM = 0.047  # width of a column of the surfaces
STEP_MM = 0.005  # along and across a ridge; finer images are averaged first
MIN_CELLS = 8
NEIGHBOURS = 0.954  # median absolute difference of two standard normal variables


class ScanScale(NamedTuple):
    """Size of a pixel."""

    lateral_mm: float
    axial_mm: float

    @property
    def mean_mm(self) -> float:
        """Geometric mean, for oblique lengths."""
        return math.sqrt(self.lateral_mm * self.axial_mm)


class ScanImage(NamedTuple):
    """One B-scan."""

    image: Image
    """(h, w) grey; averaged where the scan is finer than needed."""
    averaged_px: int
    """Pixels of the scan in each direction that make one of the image."""
    scale: ScanScale
    """Of the image."""
    grid: ScanGrid
    """The image, downsampled."""
    cell_px: tuple[float, float]
    """Columns and rows of a cell."""
    levels: GridLevels

    @property
    def pixel_sd_grey(self) -> float:
        """Standard deviation of the noise of one pixel, if neighbours are independent."""
        cell_grey = max(self.levels.difference_grey / NEIGHBOURS, 0.25)
        return cell_grey * math.sqrt(self.cell_px[0] * self.cell_px[1])

    @property
    def column_px(self) -> float:
        """Width of a column of the surfaces."""
        return self.grid.group * self.cell_px[0]

    def scan_px(self, at_px: float) -> float:
        """Return a position of the image in pixels of the scan."""
        return self.averaged_px * (at_px + 0.5) - 0.5


def scan_image(image: Image, scale: ScanScale) -> ScanImage:
    """Prepare an image, (h, w) grey."""
    averaged = max(1, round(STEP_MM / scale.mean_mm))
    if averaged > 1:
        averaged = min(averaged, min(image.shape) // MIN_CELLS)
        sums = sum_squares(image, averaged, averaged)
        image = ((sums + averaged * averaged // 2) // (averaged * averaged)).astype(np.uint8)
        scale = ScanScale(averaged * scale.lateral_mm, averaged * scale.axial_mm)
    height, width = image.shape
    across = max(1.0, min(LATERAL_MM / scale.lateral_mm, width / MIN_CELLS))
    down = max(1.0, min(AXIAL_MM / scale.axial_mm, height / MIN_CELLS))
    group = max(1, min(round(COLUMN_MM / (across * scale.lateral_mm)), int(width / across) // MIN_CELLS))
    grid = ScanGrid(average_cells(np.ascontiguousarray(image), across, down), group)
    return ScanImage(image, averaged, scale, grid, (across, down), grid.levels())
