"""A first estimate of an instrument's tip and heading: from the largest region seen along the beam."""

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.imaging import Mask
from haptigraph.perception.instrument.model import VoxelMm
from haptigraph.perception.instrument.rotations import Array
from haptigraph.perception.native.volume import ROWS_PER_CELL, ReducedVolume

__all__ = ["FirstEstimate", "estimate_first", "foreground_level"]

Indices = NDArray[np.intp]

MIN_CELLS = 2
"""Of an A-scan that must be bright."""
MAX_SHARE = 0.4
"""Of an A-scan's cells; more is a saturated A-scan, which has no depth."""
MIN_REGION = 12
"""A-scans that a region must have."""
END_SHARE = 0.1
"""Of the region's length that counts as its end."""
LEVEL_PERCENTILE = 99.5
LEVEL_SHARE = 0.45
"""Foreground is brighter than this share of the brightest cells."""


class FirstEstimate(Struct, frozen=True):
    """A rough position of the tip."""

    tip_mm: Array
    """In the eye frame, (3,)."""
    heading_deg: float
    """Direction towards the tip in the plane across the beam, from x towards z."""


def foreground_level(volume: ReducedVolume) -> float:
    """Return the level above which cells belong to an instrument that is alone in its volume."""
    cells = volume.cells[:, :, volume.first_cell : volume.last_cell + 1]
    return LEVEL_SHARE * float(np.percentile(cells[::2, ::2], LEVEL_PERCENTILE))


def estimate_first(volume: ReducedVolume, rows: int, voxel_mm: VoxelMm, level: float) -> FirstEstimate | None:
    """Estimate tip and direction of an instrument that is alone in its volume.

    Returns:
        The estimate, or None if nothing bright is connected.
    """
    is_bright = volume.cells > level
    is_bright[:, :, : volume.first_cell] = is_bright[:, :, volume.last_cell + 1 :] = False
    counts = is_bright.sum(axis=2)
    region = _largest_region(counts >= MIN_CELLS)
    if region is None:
        return None
    columns, slices = np.nonzero(region)
    sides_mm = np.array([voxel_mm[2], voxel_mm[1]])
    centre = (np.array(region.shape) - 1) / 2
    places_mm = (np.column_stack([columns, slices]) - centre) * sides_mm
    towards = _towards_tip(places_mm, columns, slices, region.shape)
    along_mm = places_mm @ towards
    at_tip = along_mm > along_mm.max() - max(END_SHARE * float(np.ptp(along_mm)) / 2, max(sides_mm))
    has_depth = counts[columns, slices] <= MAX_SHARE * counts.dtype.type(volume.cells.shape[2])
    with_depth = at_tip & has_depth if (at_tip & has_depth).any() else at_tip
    cell = float(np.nonzero(is_bright[columns[with_depth], slices[with_depth]])[1].mean())
    row = cell * ROWS_PER_CELL + (ROWS_PER_CELL - 1) / 2
    x_mm, z_mm = places_mm[at_tip].mean(axis=0)
    tip_mm = np.array([x_mm, ((rows - 1) / 2 - row) * voxel_mm[0], z_mm])
    return FirstEstimate(tip_mm, float(np.rad2deg(np.arctan2(towards[1], towards[0]))))


def _largest_region(mask: Mask) -> Mask | None:
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    areas = stats[1:, cv2.CC_STAT_AREA]
    if not areas.size or areas.max() < MIN_REGION:
        return None
    return np.asarray(labels == 1 + int(areas.argmax()))


def _towards_tip(places_mm: Array, columns: Indices, slices: Indices, shape: tuple[int, ...]) -> Array:
    """Return the region's direction towards the end that touches the border less, else the thinner one."""
    _, _, axes = np.linalg.svd(places_mm - places_mm.mean(axis=0), full_matrices=False)
    along_mm = places_mm @ axes[0]
    is_border = (columns == 0) | (slices == 0) | (columns == shape[0] - 1) | (slices == shape[1] - 1)
    margin_mm = END_SHARE * np.ptp(along_mm)
    ends = along_mm > along_mm.max() - margin_mm, along_mm < along_mm.min() + margin_mm
    borders, widths = [int((end & is_border).sum()) for end in ends], [int(end.sum()) for end in ends]
    is_reversed = (borders[0], widths[0]) > (borders[1], widths[1])
    direction: Array = -axes[0] if is_reversed else axes[0]
    return direction
