"""Passes over many pixels: learning of the background, light, stained tissue (`pixels.c`)."""

import ctypes
from operator import index
from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.imaging import FloatImage, Mask
from haptigraph.messages import Image
from haptigraph.perception.native.arrays import (
    BOOL,
    BYTE,
    FLOAT,
    INT,
    address,
    checked,
    checked_copy,
    checked_image,
    checked_share,
    owners_of,
)
from haptigraph.perception.native.library import LIBRARY

__all__ = ["LearnedBackground", "Marked", "PixelSample", "Region", "fill_marked", "mark_stains"]

Region = tuple[slice, slice]
"""Rows and columns of an image, each with a start and a stop within it."""

MAX_GREY = 255
MAX_REACH_PX = 1000  # the sum of a window's grey fits an int

_MARKED = LIBRARY.layout("Marked", ("i", "count first_row last_row first_column last_column"))
_learn_background = LIBRARY.function("learn_background", "piniidppppp")
_ranked_grey = LIBRARY.function("ranked_grey", "pipii", ctypes.c_int)
_mark_stains = LIBRARY.function("mark_stains", "pniiiippppp")
_fill_marked = LIBRARY.function("fill_marked", "pniipipp")


class Marked(Struct, frozen=True):
    """Marked pixels of a mask."""

    count: int
    within: Region
    """Rows and columns from the first to the last that has some; empty without any."""


class PixelSample:
    """Some pixels of all images of one size. It keeps a copy: nobody changes an index after its check.

    Args:
        size_px: Height and width of the images.
        pixels: Their indices, ascending, (n,) int32.
    """

    def __init__(self, size_px: tuple[int, int], pixels: NDArray[np.int32]) -> None:
        height_px, width_px = self._size_px = index(size_px[0]), index(size_px[1])
        self._pixels = checked_copy("pixels", pixels, INT, (len(pixels),), height_px * width_px)

    def ranked_grey(self, image: Image, rank: int) -> int:
        """Return the grey of the pixel that has so many before it in the order of their grey.

        Args:
            image: (h, w, 3) BGR or (h, w) grey.
            rank: From 0 to less than the number of pixels.
        """
        first, channels = checked_image("image", image, self._size_px)
        if not 0 <= index(rank) < len(self._pixels):
            raise ValueError(f"rank: expected one of {len(self._pixels)} pixels; found {rank}")
        return int(_ranked_grey(first, channels, address(self._pixels), len(self._pixels), rank))


class LearnedBackground:
    """The background of all images of one size. Its arrays are checked once, for they are many.

    Args:
        is_inside: Pixels within the globe, (h, w).
        was_visible: Pixels that were free before, (h, w); is updated.
        grey: The background, (h, w); is updated.
        chroma: How much bluer than red it is, (h, w); is updated, unless it is None.
    """

    def __init__(
        self, is_inside: Mask, was_visible: Mask, grey: FloatImage, chroma: FloatImage | None
    ) -> None:
        self._size_px = size_px = np.shape(grey)[:2]
        self._inside = checked("is_inside", is_inside, BOOL, size_px)
        self._visible = checked("was_visible", was_visible, BOOL, size_px)
        self._grey = checked("grey", grey, FLOAT, size_px)
        self._chroma = 0 if chroma is None else checked("chroma", chroma, FLOAT, size_px)
        self._owners = owners_of(is_inside, was_visible, grey, *([] if chroma is None else [chroma]))

    def learn(self, image: Image, region: Region, chroma_share: float, is_free: Mask | None) -> None:
        """Learn what is visible of it in a region; what is free for the first time as it is.

        Args:
            image: (h, w, 3) BGR or (h, w) grey.
            region: Part of the image.
            chroma_share: Of blue less red in the grey within the globe, -1 to 1.
            is_free: Pixels of the region that the needle does not occlude; None if it is elsewhere.
        """
        pixels, channels = checked_image("image", image, self._size_px)
        first, rows, columns = _checked_region(region, self._size_px)
        free = 0 if is_free is None else checked("is_free", is_free, BOOL, (rows, columns))
        _learn_background(
            *(pixels + channels * first, channels, self._size_px[1], rows, columns),
            *(checked_share("chroma_share", chroma_share), self._inside + first, free),
            *(self._visible + first, self._grey + 4 * first, self._chroma and self._chroma + 4 * first),
        )


def mark_stains(
    image: Image,
    region: Region,
    min_blue_grey: int,
    min_red_grey: int,
    spans: NDArray[np.int32],
    dye: Mask,
    blood: Mask,
) -> tuple[Marked, Marked]:
    """Mark dye and blood in a region; return how many pixels are dye, how many blood, and where.

    Args:
        image: (h, w, 3) BGR.
        region: Part of the image.
        min_blue_grey: What is bluer by more than that than it is green or red is dye, 0 to 255.
        min_red_grey: What is redder by more than that than it is green or blue is blood, 0 to 255.
        spans: First column of each row that may be either, and the first that may not again, (h, 2) int32.
        dye: Receives those that are dye, (h, w) of the region.
        blood: Receives those that are blood.
    """
    size_px = np.shape(image)[:2]
    pixels = checked("image", image, BYTE, (*size_px, 3))
    first, rows, columns = _checked_region(region, size_px)
    if not (0 <= min_blue_grey <= MAX_GREY and 0 <= min_red_grey <= MAX_GREY):
        raise ValueError(f"stains: expected 0 to {MAX_GREY}; found {min_blue_grey} and {min_red_grey}")
    masks = (("dye", dye), ("blood", blood))
    found = np.empty(2 * _MARKED.size, np.uint8)
    dyed_at = address(found)
    _mark_stains(
        *(pixels + 3 * first, size_px[1], rows, columns, min_blue_grey, min_red_grey),
        checked("spans", spans, INT, (rows, 2)),
        *(checked(name, mask, BOOL, (rows, columns)) for name, mask in masks),
        *(dyed_at, dyed_at + _MARKED.size),
    )
    dyed, bloody = (_marked(*values) for values in _MARKED.iter_unpack(found.data))
    return dyed, bloody


def fill_marked(image: Image, region: Region, is_filled: Mask, reach_px: int, filled: Image) -> None:
    """Fill marked pixels with the mean of the others in the square about each, if it has any.

    Args:
        image: (h, w, 3) BGR.
        region: Part of the image; beyond its border, it counts as mirrored.
        is_filled: The marked pixels of the region.
        reach_px: Of the square to each side.
        filled: Receives the filled pixels, another (h, w, 3) BGR.
    """
    size_px = np.shape(image)[:2]
    pixels = checked("image", image, BYTE, (*size_px, 3))
    first, rows, columns = _checked_region(region, size_px)
    if not 0 <= index(reach_px) <= MAX_REACH_PX:
        raise ValueError(f"reach: expected 0 to {MAX_REACH_PX} px; found {reach_px}")
    target = checked("filled", filled, BYTE, (*size_px, 3))
    if not filled.flags.writeable or np.may_share_memory(image, filled):
        raise ValueError("filled: expected a writeable image of its own")
    sums = np.empty(4 * columns, np.int32)
    _fill_marked(
        *(
            pixels + 3 * first,
            size_px[1],
            rows,
            columns,
            checked("is_filled", is_filled, BOOL, (rows, columns)),
        ),
        *(reach_px, address(sums), target + 3 * first),
    )


def _marked(count: int, top: int, bottom: int, left: int, right: int) -> Marked:
    return Marked(count, (slice(top, bottom + 1), slice(left, right + 1)))


def _checked_region(region: Region, size_px: tuple[Any, ...]) -> tuple[int, int, int]:
    """Return the index of a region's first pixel, its rows and its columns."""
    (rows, columns), (height_px, width_px) = region, size_px
    if not (0 <= rows.start <= rows.stop <= height_px and 0 <= columns.start <= columns.stop <= width_px):
        raise ValueError(f"region: expected one within {height_px} x {width_px} px; found {region}")
    return rows.start * width_px + columns.start, rows.stop - rows.start, columns.stop - columns.start
