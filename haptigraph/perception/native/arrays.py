"""Checks of arrays before C reads or writes them."""

import ctypes
import math
from typing import Any

import numpy as np
from numpy import ndarray
from numpy.typing import NDArray

from haptigraph.messages import Image
from haptigraph.perception.native.library import LIBRARY

__all__ = [
    "address",
    "checked",
    "checked_copy",
    "checked_image",
    "checked_planes",
    "checked_rows",
    "checked_scale",
    "checked_share",
    "owners_of",
]

MIN_LANES, MAX_LANES = LIBRARY.constant("MIN_LANES"), LIBRARY.constant("MAX_LANES")
MAX_STATIONS = LIBRARY.constant("MAX_STATIONS")
FLOAT, BYTE, BOOL, INT = (np.dtype(type_) for type_ in (np.float32, np.uint8, np.bool_, np.int32))

_DATA_AT = object.__basicsize__  # in NumPy's arrays the address of the values follows Python's own fields
_size_at = ctypes.c_size_t.from_address


def address(array: NDArray[Any]) -> int:
    """Return the address of an array's first value; the caller must keep the array while C uses it."""
    return _size_at(id(array) + _DATA_AT).value  # a seventh of the time of array.ctypes.data


def checked(name: str, array: NDArray[Any], dtype: np.dtype[Any], shape: tuple[int, ...]) -> int:
    """Return the address of an array that C reads.

    Args:
        name: What to call it in an error.
        array: C-contiguous and aligned.
        dtype: Of its values.
        shape: Of the array.
    """
    if type(array) is not ndarray:
        raise _wrong_type(name, array)
    flags = array.flags
    if array.dtype != dtype or array.shape != shape or not flags.c_contiguous or not flags.aligned:
        raise ValueError(f"{name}: expected contiguous {dtype} of shape {shape}; found {_description(array)}")
    return address(array)


def checked_copy(
    name: str, array: NDArray[Any], dtype: np.dtype[Any], shape: tuple[int, ...], stop: int | None = None
) -> NDArray[Any]:
    """Return a checked copy, which nobody can change; `stop` is the least value that is out of range."""
    checked(name, array, dtype, shape)
    copy = array.copy()
    if stop is not None and copy.size and not 0 <= copy.min() <= copy.max() < stop:
        raise ValueError(f"{name}: expected indices from 0 to {stop - 1}; found {copy.min()} to {copy.max()}")
    return copy


def checked_image(name: str, image: Image, size_px: tuple[int, int]) -> tuple[int, int]:
    """Return the address of an image, (h, w, 3) or (h, w), and its number of channels."""
    if type(image) is not ndarray:
        raise _wrong_type(name, image)
    is_color = image.ndim == 3
    return checked(name, image, BYTE, (*size_px, 3) if is_color else size_px), 3 if is_color else 1


def checked_rows(name: str, array: NDArray[np.float32]) -> tuple[int, int, int, int]:
    """Return an array as the `Rows` of native.h: address, values from lane to lane, lanes, stations.

    Args:
        name: What to call it in an error.
        array: (lanes, stations) of float32; the values of a lane are contiguous.
    """
    if type(array) is not ndarray:
        raise _wrong_type(name, array)
    strides, first = array.strides, address(array)
    if array.dtype != FLOAT or len(strides) != 2 or strides[1] != 4 or strides[0] % 4 or first % 4:
        expected = "(lanes, stations) of float32 with contiguous lanes"
        raise ValueError(f"{name}: expected {expected}; found {_description(array)}")
    lanes, stations = array.shape
    if not (MIN_LANES <= lanes <= MAX_LANES and stations <= MAX_STATIONS):
        limits = f"{MIN_LANES} to {MAX_LANES} lanes and at most {MAX_STATIONS} stations"
        raise ValueError(f"{name}: expected {limits}; found {lanes} and {stations}")
    return first, strides[0] // 4, lanes, stations


def checked_planes(name: str, array: NDArray[np.float32]) -> tuple[int, int, int, int, int]:
    """Return two or three planes of a shape: bytes from one to the next, and the first as `checked_rows`."""
    if type(array) is not ndarray:
        raise _wrong_type(name, array)
    if array.ndim != 3 or not 2 <= len(array) <= 3 or array.strides[0] % 4:
        raise ValueError(f"{name}: expected 2 or 3 planes of rows; found {_description(array)}")
    return array.strides[0], *checked_rows(name, array[0])


def checked_share(name: str, share: float) -> float:
    """Return a share, which C multiplies with integers."""
    if not -1 <= share <= 1:
        raise ValueError(f"{name}: expected a number from -1 to 1, found {share}")
    return float(share)


def checked_scale(px_per_mm: float) -> float:
    """Return a scale, by which C divides."""
    if not 0 < px_per_mm < math.inf:
        raise ValueError(f"px_per_mm: expected a positive number, found {px_per_mm}")
    return float(px_per_mm)


def owners_of(*arrays: NDArray[Any]) -> tuple[Any, ...]:
    """Return what owns the arrays' memory, to keep: NumPy resizes no array that others refer to."""
    return *arrays, *(array.base for array in arrays)


def _wrong_type(name: str, array: Any) -> TypeError:
    """Return the error for what is no array, or of a subclass, which could misreport its shape."""
    return TypeError(f"{name}: expected a NumPy array, found {type(array).__name__}")


def _description(array: NDArray[Any]) -> str:
    return f"{array.dtype} of shape {array.shape}, {array.strides} bytes apart"
