"""The metal at the end of a forceps' shaft, in a patch along it (`jaws.c`)."""

import ctypes
from operator import index

import numpy as np

from haptigraph.geometry import Vec
from haptigraph.imaging import FloatImage, Mask
from haptigraph.messages import Image
from haptigraph.perception.native.arrays import (
    BOOL,
    BYTE,
    FLOAT,
    MAX_LANES,
    MAX_STATIONS,
    address,
    checked,
)
from haptigraph.perception.native.library import LIBRARY, pack

__all__ = ["find_jaws"]

_PATCH = LIBRARY.layout(
    "JawPatch",
    *(("p", "grey pixels background is_other"), ("d", "light center_px radius_px min_length_px")),
    *(("d", "max_difference_px"), ("i", "lanes stations core visible")),
)
_RUN_BYTES = LIBRARY.constant("Run")

_find_jaws = LIBRARY.function("find_jaws", "ppppip", ctypes.c_int)
_Tips = ctypes.c_double * 4


def find_jaws(
    grey: Image,
    pixels: Image | None,
    background: FloatImage,
    light: float,
    *,
    core_px: int,
    visible_px: int,
    globe: tuple[Vec, float],
    is_other: Mask | None,
    min_length_px: float,
    max_difference_px: float,
) -> tuple[Vec, Vec] | None:
    """Return (station, lane) of the tips of both jaws, first of the one beyond the middle lane.

    Args:
        grey: The patch, (lanes, stations); the shaft's line is its middle lane.
        pixels: The same in colour, (lanes, stations, 3) BGR, if it has any.
        background: The eye without forceps, (lanes, stations).
        light: How many times brighter the patch is than the background.
        core_px: Lanes to either side of the middle one that the shaft covers for sure.
        visible_px: Stations in which it is visible for sure, from the first on.
        globe: Centre (station, lane) and radius, without the rim.
        is_other: Pixels of another instrument, (lanes, stations); None without one.
        min_length_px: Of metal, from the first station.
        max_difference_px: Between two jaws; else, they are closed and beside the line.
    """
    size_px = lanes, stations = np.shape(grey)
    if not (3 <= lanes <= MAX_LANES and 0 < stations <= MAX_STATIONS):
        limits = f"3 to {MAX_LANES} lanes and 1 to {MAX_STATIONS} stations"
        raise ValueError(f"patch: expected {limits}; found {lanes} and {stations}")
    if not (0 <= index(core_px) <= (lanes - 1) // 2 and 0 < index(visible_px) <= stations):
        raise ValueError(f"shaft: expected one within {lanes} x {stations} px; found {core_px}, {visible_px}")
    (x, y), radius_px = globe
    packed = pack(
        _PATCH,
        checked("grey", grey, BYTE, size_px),
        0 if pixels is None else checked("pixels", pixels, BYTE, (lanes, stations, 3)),
        checked("background", background, FLOAT, size_px),
        0 if is_other is None else checked("is_other", is_other, BOOL, size_px),
        *(float(light), float(x), float(y), float(radius_px), float(min_length_px), float(max_difference_px)),
        *(lanes, stations, core_px, visible_px),
    )
    runs = lanes * (stations // 4 + 2)  # more gaps are none after closing
    masks, found = np.empty((2, lanes, stations), np.bool_), np.empty(runs * _RUN_BYTES, np.uint8)
    tips_px, first = _Tips(), address(masks)
    if not _find_jaws(packed, first, first + lanes * stations, address(found), runs, tips_px):
        return None
    return (tips_px[0], tips_px[1]), (tips_px[2], tips_px[3])
