"""Volumes and the template of an instrument, as Python and C share them (`volume.c`)."""

import ctypes
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.typing import NDArray

from haptigraph.imaging import FloatImage, Mask
from haptigraph.perception.native.arrays import BOOL, BYTE, FLOAT, address, checked
from haptigraph.perception.native.library import LIBRARY, pack

__all__ = ["ROWS_PER_CELL", "ReducedVolume", "Template", "reduce_volume"]

ROWS_PER_CELL = LIBRARY.constant("VOLUME_CELL")
"""Rows of a volume that a cell of a reduced one averages."""

PADDED = LIBRARY.constant("VOLUME_PADDED")
MAX_ROWS = LIBRARY.constant("MAX_VOLUME_ROWS")
MAX_SIDE, MAX_POINTS = 4096, 2**24  # their products fit ptrdiff_t, and counts an int
DOUBLE = np.dtype(np.float64)

_VOLUME = LIBRARY.layout("ReducedVolume", ("p", "first"), ("i", "columns slices cells first_cell last_cell"))
_reduce_volume = LIBRARY.function("reduce_volume", "pnnniiippp")
_add_samples = LIBRARY.function("add_samples", "ppippp")
_compare_template = LIBRARY.function("compare_template", "ppppippdppp", ctypes.c_double)


class ReducedVolume:
    """A volume whose rows were reduced to cells.

    Args:
        cells: Square root of the smoothed grey, 0 to 255, (columns, slices, cells).
        first_cell: The first one with usable rows.
        last_cell: The last one, inclusive.
    """

    def __init__(self, cells: NDArray[np.float32], first_cell: int, last_cell: int) -> None:
        if np.ndim(cells) != 3 or not all(2 <= side <= MAX_SIDE for side in cells.shape):
            raise ValueError(f"cells: expected (columns, slices, cells); found shape {np.shape(cells)}")
        at = checked("cells", cells, FLOAT, cells.shape)
        if not 0 <= first_cell <= last_cell < cells.shape[2]:
            raise ValueError(f"cells: expected a part of {cells.shape[2]}; found {first_cell} to {last_cell}")
        self.cells, self.first_cell, self.last_cell = cells, first_cell, last_cell
        self._owners = cells, cells.base  # NumPy resizes no array that others refer to
        self._packed = pack(_VOLUME, at, *cells.shape, first_cell, last_cell)

    def add_samples(
        self, points: FloatImage, affine: NDArray[np.float64], sums: FloatImage, counts: FloatImage
    ) -> None:
        """Add the samples at points that are inside the volume, and count them.

        Args:
            points: (n, 3).
            affine: From a point to column, cell and slice, (3, 4).
            sums: Of the samples, (n,); is updated.
            counts: (n,); is updated.
        """
        count = _checked_count(len(points))
        _add_samples(
            *(self._packed, checked("points", points, FLOAT, (count, 3)), count),
            *(checked("affine", affine, DOUBLE, (3, 4)), checked("sums", sums, FLOAT, (count,))),
            checked("counts", counts, FLOAT, (count,)),
        )

    def compare(
        self, template: "Template", affine: NDArray[np.float64], is_used: Mask, knee: float
    ) -> tuple[float, int, NDArray[np.float64], NDArray[np.float64]]:
        """Compare with a template.

        Args:
            template: What to compare with.
            affine: From a point to column, cell and slice, (3, 4).
            is_used: Points that count, (n,).
            knee: Residual beyond which Huber's cost is linear.

        Returns:
            Mean cost of a point inside the volume, their number, gradient (6,) and normal matrix (6, 6).
        """
        inside, gradient, normal = ctypes.c_int32(), np.empty(6), np.empty((6, 6))
        cost = _compare_template(
            *(self._packed, *template.addresses, template.count),
            *(
                checked("is_used", is_used, BOOL, (template.count,)),
                checked("affine", affine, DOUBLE, (3, 4)),
            ),
            *(float(knee), ctypes.addressof(inside), address(gradient), address(normal)),
        )
        return float(cost), inside.value, gradient, normal


class Template:
    """Points of a template, with values and derivatives. It keeps copies.

    Args:
        points: (n, 3).
        values: (n,).
        jacobian: Derivatives of the values with respect to shift and rotation, (n, 6).
    """

    def __init__(
        self, points: NDArray[np.float32], values: NDArray[np.float32], jacobian: NDArray[np.float32]
    ) -> None:
        count = self.count = _checked_count(len(points))
        checked("points", points, FLOAT, (count, 3))
        checked("values", values, FLOAT, (count,))
        checked("jacobian", jacobian, FLOAT, (count, 6))
        padded = np.zeros((count, PADDED), np.float32)
        padded[:, :6] = jacobian
        self._arrays = points.copy(), values.copy(), padded
        self.addresses = tuple(map(address, self._arrays))


def reduce_volume(volume: NDArray[np.uint8], is_usable: Mask) -> ReducedVolume:
    """Average the usable rows over cells, smooth along the beam, and take the square root.

    Args:
        volume: (rows, slices, columns), in any order of the axes in memory.
        is_usable: Rows without a fixed reflection, (rows,).
    """
    if type(volume) is not ndarray or volume.dtype != BYTE or volume.ndim != 3:
        raise TypeError(f"volume: expected three-dimensional uint8; found {_description(volume)}")
    rows, slices, columns = volume.shape
    if not (2 * ROWS_PER_CELL <= rows <= MAX_ROWS and 2 <= slices <= MAX_SIDE and 2 <= columns <= MAX_SIDE):
        limits = f"{2 * ROWS_PER_CELL} to {MAX_ROWS} rows, 2 to {MAX_SIDE} slices and columns"
        raise ValueError(f"volume: expected {limits}; found {volume.shape}")
    usable = checked("is_usable", is_usable, BOOL, (rows,))
    reduced = np.empty((columns, slices, rows // ROWS_PER_CELL), np.float32)
    is_usable_cell = np.empty(rows // ROWS_PER_CELL, np.bool_)
    _reduce_volume(
        *(address(volume), *volume.strides, rows, slices, columns),
        *(usable, address(is_usable_cell), address(reduced)),
    )
    cells = np.flatnonzero(is_usable_cell)
    if not cells.size:
        raise ValueError("is_usable: expected some usable rows")
    return ReducedVolume(reduced, int(cells[0]), int(cells[-1]))


def _checked_count(count: int) -> int:
    if not 0 < count <= MAX_POINTS:
        raise ValueError(f"points: expected 1 to {MAX_POINTS}; found {count}")
    return count


def _description(value: Any) -> str:
    if not isinstance(value, ndarray):
        return type(value).__name__
    return f"{value.dtype} of shape {value.shape}"
