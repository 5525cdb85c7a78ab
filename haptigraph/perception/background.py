"""The empty eye as the camera sees it, learned while the needle is elsewhere.

Turns images and where the needle was in them into the grey picture behind the needle. Pixels that were never
seen without the needle are marked UNSEEN. Learns a band of rows per image, so that it costs next to nothing.
"""

from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.geometry import Vec, unit
from haptigraph.messages import Image
from haptigraph.perception.pixels import FloatImage, grey_of
from haptigraph.perception.strip import UNSEEN

__all__ = ["Background"]

BANDS = 16
RATE = 0.25


class Background:
    """A slowly adapting picture of the empty eye.

    Args:
        width_px: Of the image.
        height_px: Of the image.
        box: Rows and columns of the image that are worth knowing.
    """

    def __init__(self, width_px: int, height_px: int, box: tuple[slice, slice]) -> None:
        self._size = height_px, width_px
        rows, self._columns = box
        edges = [rows.start + band * (rows.stop - rows.start) // BANDS for band in range(BANDS + 1)]
        self._bands = [slice(*ends) for ends in pairwise(edges)]
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self.grey: FloatImage = np.full(self._size, UNSEEN, np.float32)
        self._band = 0
        self.is_new = True
        self._is_whole = [False] * BANDS

    def learn(self, image: Image, needle: tuple[Vec, Vec] | None, width_px: int) -> None:
        """Take in what is visible of the empty eye.

        Args:
            image: The image.
            needle: The two ends of what the needle may cover [px]; None if there is no needle.
            width_px: How wide a stripe about it to leave out.
        """
        bands = range(BANDS) if self.is_new else (self._band,)
        for band in bands:
            self._learn_band(image, band, needle, width_px)
        self._band = (self._band + 1) % BANDS
        self.is_new = False

    def _learn_band(self, image: Image, band: int, needle: tuple[Vec, Vec] | None, width_px: int) -> None:
        rows, columns = self._bands[band], self._columns
        grey, kept = grey_of(image[rows, columns]), self.grey[rows, columns]
        free = np.full(grey.shape, 255, np.uint8)
        if needle is not None:
            cv2.fillConvexPoly(free, _stripe(needle, width_px, (columns.start, rows.start)), 0, shift=4)
        if not self._is_whole[band]:
            unseen = kept < 0
            fresh = unseen & (free > 0)
            kept[fresh] = grey[fresh]
            free[unseen] = 0
            self._is_whole[band] = bool((kept >= 0).all())
        cv2.accumulateWeighted(grey, kept, RATE, free)


def _stripe(ends: tuple[Vec, Vec], width_px: int, corner_px: Vec) -> NDArray[np.int32]:
    """Return the corners of a stripe in 1/16 pixels of an image that begins at a corner."""
    (x0, y0), (x1, y1) = ends
    across = unit((y0 - y1, x1 - x0))
    half_x, half_y = across[0] * width_px / 2, across[1] * width_px / 2
    corners = [(x0 - half_x, y0 - half_y), (x1 - half_x, y1 - half_y), (x1 + half_x, y1 + half_y)]
    corners.append((x0 + half_x, y0 + half_y))
    return np.rint((np.array(corners) - corner_px) * 16).astype(np.int32)
