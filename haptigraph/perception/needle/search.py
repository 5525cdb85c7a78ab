"""Acquisition: a search for the needle along one number, the angle at which it leaves the trocar.

Turns an image into a few candidate lines. The image is unrolled about the trocar (angle x radius), where
every needle is a straight row; a row counts that differs from both its sides without a gap, inwards from
the wall or from the far end of the shaft towards it. Before it is in there a needle may point beside it: such
lines are searched in the same way. Knows nothing of earlier images, and does not decide.
"""

import math
import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from haptigraph.imaging import Floats, Mask
from haptigraph.messages import Image
from haptigraph.perception.native.library import address, function
from haptigraph.perception.needle.rectify import LARGEST_TURN_RAD, OUTSIDE_MM, Line, Site

__all__ = ["PolarSearch"]

STEP_DEG = 0.75
STEP_PX = 2.0
CELL = 4
LONGEST_MM = 25.0
FLANK_MM = 0.6
LEAST_CELLS = 2.0
CANDIDATES = 3
APART = 6  # rows of the fan between two candidates

_pack = struct.Struct("PPPPPiiii").pack
_score_fan = function("score_fan", "ppiddpp")


class PolarSearch:
    """The image unrolled about one trocar.

    Args:
        site: Where trocar and globe are.
        offsets_mm: At which the lines pass the trocar.
        until_mm: How far beyond it they are looked at.
    """

    def __init__(
        self, site: Site, offsets_mm: Sequence[float] = (0.0,), until_mm: float = LONGEST_MM
    ) -> None:
        reach = round(math.degrees(LARGEST_TURN_RAD) / STEP_DEG)
        self._angles = site.inwards_rad + np.radians(STEP_DEG) * np.arange(-reach, reach + 1)
        self._offsets_px = site.px_per_mm * np.array(offsets_mm)
        self._size = site.height_px, site.width_px
        radii = np.arange(-OUTSIDE_MM * site.px_per_mm, until_mm * site.px_per_mm, STEP_PX)
        radii = radii[: len(radii) // CELL * CELL]
        rows = len(self._offsets_px) * len(self._angles)
        offset, angle = (
            part.reshape(-1, 1) for part in np.meshgrid(self._offsets_px, self._angles, indexing="ij")
        )
        x = site.trocar_px[0] + radii * np.cos(angle) - offset * np.sin(angle)
        y = site.trocar_px[1] + radii * np.sin(angle) + offset * np.cos(angle)
        cells = rows, len(radii) // CELL, CELL
        cell_px = radii.reshape(-1, CELL).mean(axis=1)
        trocar = int(cell_px.searchsorted(0))
        is_told = _told(site, x.reshape(cells), y.reshape(cells), np.arange(len(cell_px)) < trocar)
        flanks = _flanks(site, cell_px, rows, len(self._angles))
        is_sampled = is_told.copy()
        is_sampled.ravel()[flanks[:, is_told]] = True
        columns, rows_px = (
            np.rint(part).clip(0, size - 1).reshape(cells)[is_sampled].astype(np.int32)
            for part, size in ((x, site.width_px), (y, site.height_px))
        )
        pixels = (rows_px * site.width_px + columns).ravel()
        order = pixels.argsort(kind="stable")
        cell = np.flatnonzero(is_sampled).astype(np.int32).repeat(CELL)
        is_bluer = np.hypot(columns - site.center_px[0], rows_px - site.center_px[1]).ravel() < site.outer_px
        self._layout = pixels[order], cell[order], is_bluer[order], flanks, is_told
        self._ends = len(order), *is_told.shape, trocar
        self._grey, self._score = np.empty(is_told.shape, np.float32), np.empty(rows, np.float32)

    def search(self, image: Image, chroma_share: float = 0.0, light: float = 1.0) -> list[Line]:
        """Return the lines most like a needle, best first.

        Args:
            image: (h, w, 3) BGR or (h, w) grey.
            chroma_share: Of blue less red in the grey within the globe.
            light: How many times brighter the image would be in good light.

        Raises:
            ValueError: If the image is not of the registered size.
        """
        if image.shape[:2] != self._size:
            raise ValueError(f"expected an image of {self._size}, found {image.shape}")
        image = np.ascontiguousarray(image)
        channels = 1 if image.ndim == 2 else image.shape[2]
        _score_fan(
            _pack(*(address(array) for array in self._layout), *self._ends),
            *(address(image), channels, chroma_share, light),
            *(address(self._grey), address(self._score)),
        )
        score = self._score.reshape(len(self._offsets_px), len(self._angles))
        found = []
        for _ in range(CANDIDATES):
            offset, angle = divmod(int(score.argmax()), len(self._angles))
            if score[offset, angle] < LEAST_CELLS:
                break
            found.append(Line(float(self._angles[angle]), float(self._offsets_px[offset])))
            score[:, max(angle - APART, 0) : angle + APART + 1] = 0
        return found


def _told(site: Site, x_px: Floats, y_px: Floats, is_before: Mask) -> Mask:
    """Return which cells tell something: those that are whole before the wall, or within it.

    Args:
        site: Where things are.
        x_px: Of every sample in the image, (rows, cells, CELL).
        y_px: The same.
        is_before: Cells before the trocar, (cells,).
    """
    radius_px = np.hypot(x_px - site.center_px[0], y_px - site.center_px[1])
    in_image = (x_px >= 0) & (y_px >= 0) & (x_px < site.width_px) & (y_px < site.height_px)
    is_inside = radius_px.max(axis=2) < site.inner_px - STEP_PX
    is_outside = (radius_px.min(axis=2) > site.outer_px) & in_image.all(axis=2)
    return np.asarray(np.where(is_before, is_outside, is_inside), np.bool_)


def _flanks(site: Site, cell_px: Floats, rows: int, angles: int) -> NDArray[np.int32]:
    """Return the numbers of the cells on either side of every one, (2, rows, cells).

    Args:
        site: Where things are.
        cell_px: How far from the trocar cells are, (cells,).
        rows: How many.
        angles: How many of them belong to lines that pass the trocar at one place.
    """
    apart_rad = FLANK_MM * site.px_per_mm / np.maximum(np.abs(cell_px), 8.0)
    apart = np.rint(np.clip(apart_rad / math.radians(STEP_DEG), 1, 2 * APART)).astype(int)
    row, column = np.mgrid[:rows, : len(cell_px)]
    first = row // angles * angles
    beside = [np.clip(row + side * apart, first, first + angles - 1) for side in (-1, 1)]
    return np.array([side * len(cell_px) + column for side in beside], np.int32)
