"""The polar search: acquisition of the needle by the angle at which it leaves the trocar.

Turns an image into a few candidate lines. The image is sampled about the trocar (angle x radius), where each
needle is a straight row. A row scores that differs from both its flanks without a gap, inwards from the wall
or from the far end of the shaft towards it (`native/search.c`). Before a needle is in its trocar it may point
beside it: such lines are searched in the same way.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from haptigraph.imaging import FloatImage, Floats, Mask
from haptigraph.messages import Image
from haptigraph.perception.native.search_grid import CELL, SearchGrid
from haptigraph.perception.needle.rectify import MAX_TURN_RAD, OUTSIDE_MM, EyeGeometry, Line

__all__ = ["MIN_SCORE", "PolarSearch"]

STEP_DEG = 0.75
STEP_PX = 2.0
MAX_LENGTH_MM = 25.0
FLANK_MM = 0.6
CANDIDATES = 3
MIN_ROWS = 6  # between two candidates

MIN_SCORE = 2.0
"""Cells; a line that scores less is no candidate."""


class PolarSearch:
    """A search of the lines through or beside one trocar.

    Args:
        eye: The eye's geometry.
        offsets_mm: At which the lines pass the trocar.
        until_mm: How far beyond it they are searched.
    """

    def __init__(
        self, eye: EyeGeometry, offsets_mm: Sequence[float] = (0.0,), until_mm: float = MAX_LENGTH_MM
    ) -> None:
        steps = round(math.degrees(MAX_TURN_RAD) / STEP_DEG)
        self._angles = eye.inwards_rad + np.radians(STEP_DEG) * np.arange(-steps, steps + 1)
        self._offsets_px = eye.px_per_mm * np.array(offsets_mm)
        radii = np.arange(-OUTSIDE_MM * eye.px_per_mm, until_mm * eye.px_per_mm, STEP_PX)
        radii = radii[: len(radii) // CELL * CELL]
        rows = len(self._offsets_px) * len(self._angles)
        offset, angle = (
            part.reshape(-1, 1) for part in np.meshgrid(self._offsets_px, self._angles, indexing="ij")
        )
        x = eye.trocar_px[0] + radii * np.cos(angle) - offset * np.sin(angle)
        y = eye.trocar_px[1] + radii * np.sin(angle) + offset * np.cos(angle)
        cells = rows, len(radii) // CELL, CELL
        cell_px = radii.reshape(-1, CELL).mean(axis=1)
        trocar = int(cell_px.searchsorted(0))
        is_before = np.arange(len(cell_px)) < trocar
        is_observable = _observable(eye, x.reshape(cells), y.reshape(cells), is_before)
        flanks = _flanks(eye, cell_px, rows, len(self._angles))
        is_sampled = is_observable.copy()
        is_sampled.ravel()[flanks[:, is_observable]] = True
        columns, rows_px = (
            np.rint(part).clip(0, size - 1).reshape(cells)[is_sampled].astype(np.int32)
            for part, size in ((x, eye.width_px), (y, eye.height_px))
        )
        pixels, samples = np.unique(rows_px * eye.width_px + columns, return_inverse=True)
        in_order = np.sort(samples.reshape(-1, CELL), axis=1).astype(np.int32)
        sampled = np.flatnonzero(is_sampled).astype(np.int32)
        row, column = np.divmod(pixels, eye.width_px)
        is_inside = np.hypot(column - eye.center_px[0], row - eye.center_px[1]) < eye.outer_px
        self._grid = SearchGrid(
            (eye.height_px, eye.width_px),
            *(pixels, is_inside, sampled, in_order, flanks, is_observable, trocar),
        )

    @property
    def angles_rad(self) -> Floats:
        """Angles of the lines into the eye, in the image, (n,)."""
        return np.asarray(self._angles, np.float64)

    def scores(self, image: Image, chroma_share: float = 0.0, light: float = 1.0) -> FloatImage:
        """Return how much every line looks like a needle, (offsets, angles) [cells]; see `search`."""
        scores = self._grid.score(np.ascontiguousarray(image), chroma_share, light)
        return np.asarray(scores.reshape(len(self._offsets_px), len(self._angles)), np.float32)

    def search(self, image: Image, chroma_share: float = 0.0, light: float = 1.0) -> list[Line]:
        """Return the lines most like a needle, best first.

        Args:
            image: (h, w, 3) BGR or (h, w) grey.
            chroma_share: Of blue less red in the grey within the globe.
            light: How many times brighter the image would be in good light.

        Raises:
            ValueError: If the image is not of the registered size.
        """
        score = self.scores(image, chroma_share, light)
        found = []
        for _ in range(CANDIDATES):
            offset, angle = divmod(int(score.argmax()), len(self._angles))
            if score[offset, angle] < MIN_SCORE:
                break
            found.append(Line(float(self._angles[angle]), float(self._offsets_px[offset])))
            score[:, max(angle - MIN_ROWS, 0) : angle + MIN_ROWS + 1] = 0
        return found


def _observable(eye: EyeGeometry, x_px: Floats, y_px: Floats, is_before: Mask) -> Mask:
    """Return the cells in which a needle would be visible: whole ones outside the wall, or within it.

    Args:
        eye: The eye's geometry.
        x_px: Of each sample in the image, (rows, cells, CELL).
        y_px: The same.
        is_before: Cells before the trocar, (cells,).
    """
    radius_px = np.hypot(x_px - eye.center_px[0], y_px - eye.center_px[1])
    in_image = (x_px >= 0) & (y_px >= 0) & (x_px < eye.width_px) & (y_px < eye.height_px)
    is_inside = radius_px.max(axis=2) < eye.inner_px - STEP_PX
    is_outside = (radius_px.min(axis=2) > eye.outer_px) & in_image.all(axis=2)
    return np.asarray(np.where(is_before, is_outside, is_inside), np.bool_)


def _flanks(eye: EyeGeometry, cell_px: Floats, rows: int, angles: int) -> NDArray[np.int32]:
    """Return the indices of the cells on either side of each cell, (2, rows, cells).

    Args:
        eye: The eye's geometry.
        cell_px: How far from the trocar cells are, (cells,).
        rows: Their number.
        angles: Number of rows whose lines have one offset from the trocar.
    """
    flank_rad = FLANK_MM * eye.px_per_mm / np.maximum(np.abs(cell_px), 8.0)
    flank_rows = np.rint(np.clip(flank_rad / math.radians(STEP_DEG), 1, 2 * MIN_ROWS)).astype(int)
    row, column = np.mgrid[:rows, : len(cell_px)]
    first = row // angles * angles
    flanks = [np.clip(row + side * flank_rows, first, first + angles - 1) for side in (-1, 1)]
    return np.array([flank * len(cell_px) + column for flank in flanks], np.int32)
