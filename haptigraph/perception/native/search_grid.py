"""The grid along which the polar search samples images (`search.c`)."""

from operator import index

import numpy as np
from numpy.typing import NDArray

from haptigraph.imaging import FloatImage, Mask
from haptigraph.messages import Image
from haptigraph.perception.native.arrays import BOOL, INT, address, checked_copy, checked_image, checked_share
from haptigraph.perception.native.library import LIBRARY, pack

__all__ = ["CELL", "SearchGrid"]

CELL = LIBRARY.constant("CELL")
"""Samples along a line that make a cell."""

MAX_CELLS = 2**30  # twice as many are counted by an int
MAX_PIXELS = 2**29  # three bytes each are counted by an int

_GRID = LIBRARY.layout(
    "SearchGrid",
    ("p", "pixels is_inside sampled samples flanks is_observable"),
    ("i", "pixel_count sampled_count rows cells trocar"),
)
_score_lines = LIBRARY.function("score_lines", "ppiddppp")


class SearchGrid:
    """Where lines sample an image. It keeps copies, so that nobody changes an index after its check.

    Args:
        size_px: Height and width of the images.
        pixels: Indices of the sampled pixels, ascending, (pixels,) int32.
        is_inside: Pixels inside the globe, (pixels,).
        sampled: Indices of the sampled cells, (sampled,) int32.
        samples: Which of `pixels` each of these cells samples, (sampled, CELL) int32.
        flanks: Indices of the cells on either side of each cell, (2, rows, cells) int32.
        is_observable: Cells in which a needle would be visible, (rows, cells).
        trocar: Cells of a row before this one are outside the eye.
    """

    def __init__(
        self,
        size_px: tuple[int, int],
        pixels: NDArray[np.int32],
        is_inside: Mask,
        sampled: NDArray[np.int32],
        samples: NDArray[np.int32],
        flanks: NDArray[np.int32],
        is_observable: Mask,
        trocar: int,
    ) -> None:
        height_px, width_px = (index(size) for size in size_px)
        count, (rows, cells) = len(pixels), np.shape(is_observable)
        if not (rows * cells <= MAX_CELLS and 0 <= index(trocar) <= cells):
            raise ValueError(f"grid: expected a trocar within at most {MAX_CELLS} cells; found {trocar}")
        if height_px * width_px > MAX_PIXELS:
            raise ValueError(f"grid: expected at most {MAX_PIXELS} pixels; found {height_px} x {width_px}")
        self._size_px, self._shape = (height_px, width_px), (rows, cells)
        self._arrays = (
            checked_copy("pixels", pixels, INT, (count,), height_px * width_px),
            checked_copy("is_inside", is_inside, BOOL, (count,)),
            checked_copy("sampled", sampled, INT, (len(sampled),), rows * cells),
            checked_copy("samples", samples, INT, (len(sampled), CELL), count),
            checked_copy("flanks", flanks, INT, (2, rows, cells), rows * cells),
            checked_copy("is_observable", is_observable, BOOL, (rows, cells)),
        )
        counts = count, len(sampled), rows, cells, trocar
        self._packed = pack(_GRID, *map(address, self._arrays), *counts)
        self._shares, self._grey = np.empty(count, np.float32), np.zeros((rows, cells), np.float32)

    def score(self, image: Image, chroma_share: float = 0.0, light: float = 1.0) -> FloatImage:
        """Return how much each row looks like a needle, (rows,).

        Args:
            image: (h, w, 3) BGR or (h, w) grey, contiguous.
            chroma_share: Of blue less red in the grey within the globe, -1 to 1.
            light: How many times brighter the image would be in good light.
        """
        pixels, channels = checked_image("image", image, self._size_px)
        score = np.empty(self._shape[0], np.float32)
        _score_lines(
            *(self._packed, pixels, channels, checked_share("chroma_share", chroma_share), float(light)),
            *(address(self._shares), address(self._grey), address(score)),
        )
        return score
