"""Rectification of strips, and subtraction of their background (`rectify.c`)."""

import ctypes
from operator import index
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from haptigraph.geometry import Vec
from haptigraph.imaging import FloatImage, Mask
from haptigraph.messages import Image
from haptigraph.perception.native.arrays import (
    FLOAT,
    MAX_LANES,
    MAX_STATIONS,
    MIN_LANES,
    address,
    checked,
    checked_image,
    checked_planes,
    checked_share,
)
from haptigraph.perception.native.library import LIBRARY

__all__ = ["Positions", "strip_positions", "subtract_background"]

Positions: TypeAlias = tuple[NDArray[np.int16], NDArray[np.uint16]]

MAX_PX = LIBRARY.constant("MAX_PX")

_strip_positions = LIBRARY.function("strip_positions", "ipiffffffpp", ctypes.c_int)
_subtract_background = LIBRARY.function("subtract_background", "piiipdddfpppp", ctypes.c_double)


def strip_positions(half_px: int, u_px: FloatImage, foot_px: Vec, normal: Vec, direction: Vec) -> Positions:
    """Return the image positions of a strip's pixels, as `cv2.remap` takes them: whole pixels, and the rest.

    Args:
        half_px: Lanes to either side of the line.
        u_px: Positions of the stations along it, (n,).
        foot_px: Where u_px is 0.
        normal: Across the line, length 1.
        direction: Along the line, length 1.
    """
    lanes, stations = 2 * index(half_px) + 1, len(u_px)
    if not (MIN_LANES <= lanes <= MAX_LANES and 0 < stations <= MAX_STATIONS):
        limits = f"{MIN_LANES} to {MAX_LANES} lanes and 1 to {MAX_STATIONS} stations"
        raise ValueError(f"strip: expected {limits}; found {lanes} and {stations}")
    along = checked("u_px", u_px, FLOAT, (stations,))
    whole, rest = np.empty((lanes, stations, 2), np.int16), np.empty((lanes, stations), np.uint16)
    (x, y), (nx, ny), (dx, dy) = foot_px, normal, direction
    is_valid = _strip_positions(
        *(lanes // 2, along, stations, float(x), float(y), float(nx), float(ny), float(dx), float(dy)),
        *(address(whole), address(rest)),
    )
    if not is_valid:
        raise ValueError(f"strip: expected finite positions within {MAX_PX} px of the image's origin")
    return whole, rest


def subtract_background(
    pixels: Image,
    planes: FloatImage,
    u_px: FloatImage,
    chroma_share: float,
    globe_px: tuple[float, float],
    light: float,
) -> tuple[Mask, float]:
    """Subtract a strip's background, and the linear ramp between the two flanks of each station.

    Args:
        pixels: The strip, (lanes, n, 3) BGR or (lanes, n) grey.
        planes: First the background's grey, negative where unknown, and third, of a strip in colour, how much
            bluer than red it is, (2 or 3, lanes, n). Is replaced by the planes of a `RectifiedStrip`; the
            third is in units in which its noise is no more than that of the grey.
        u_px: Positions of the stations, (n,).
        chroma_share: Of blue less red in the grey within the globe, -1 to 1.
        globe_px: Where along the strip the globe begins and ends.
        light: How many times brighter the strip is to be.

    Returns:
        Where the background is known, (n,), and the standard deviation of a pixel's noise [grey levels].
    """
    apart, first, stride, lanes, stations = checked_planes("planes", planes)
    if stride != stations or apart != 4 * lanes * stations or not stations or not planes.flags.writeable:
        raise ValueError("planes: expected a contiguous, writable array with at least one station")
    image, channels = checked_image("pixels", pixels, (lanes, stations))
    if len(planes) > 2 and channels != 3:
        raise ValueError("planes: expected two, for the strip is grey")
    is_known, (from_px, to_px) = np.empty(stations, np.bool_), globe_px
    noise_grey = _subtract_background(
        *(image, channels, lanes, stations, checked("u_px", u_px, FLOAT, (stations,))),
        *(checked_share("chroma_share", chroma_share), float(from_px), float(to_px), float(light)),
        *(first, first + apart, address(is_known), first + 2 * apart if len(planes) > 2 else None),
    )
    return is_known, noise_grey
