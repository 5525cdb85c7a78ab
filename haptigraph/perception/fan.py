"""Acquisition: a search for the needle along one number, the angle at which it leaves the trocar.

Turns an image into a few candidate lines. The image is unrolled about the trocar (angle x radius), where
every needle is a straight row; a row counts that differs from both its sides without a gap, inwards from
the wall or from the far end of the shaft towards it. Before it is in there a needle may point beside it: such
lines are searched in the same way. Knows nothing of earlier images, and does not decide.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from haptigraph.messages import Image
from haptigraph.perception.pixels import FloatImage, grey_with_chroma
from haptigraph.perception.strip import LARGEST_TURN_RAD, OUTSIDE_MM, Line, Site

__all__ = ["Fan"]

STEP_DEG = 0.75
STEP_PX = 2.0
CELL = 4
LONGEST_MM = 25.0
FLANK_MM = 0.6
CONTRAST_GREY = 6.0
LEAST_CELLS = 2.0
CANDIDATES = 3
APART = 6  # rows of the fan between two candidates


class Fan:
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
        radii = np.arange(-OUTSIDE_MM * site.px_per_mm, until_mm * site.px_per_mm, STEP_PX)
        radii = radii[: len(radii) // CELL * CELL]
        rows = len(self._offsets_px) * len(self._angles)
        offset, angle = (
            part.reshape(-1, 1) for part in np.meshgrid(self._offsets_px, self._angles, indexing="ij")
        )
        x = site.trocar_px[0] + radii * np.cos(angle) - offset * np.sin(angle)
        y = site.trocar_px[1] + radii * np.sin(angle) + offset * np.cos(angle)
        self._map, self._none = cv2.convertMaps(
            x.astype(np.float32), y.astype(np.float32), cv2.CV_16SC2, nninterpolation=True
        )
        self._cells = rows, len(radii) // CELL, CELL
        radius = np.hypot(x - site.center_px[0], y - site.center_px[1])
        self._is_inside = radius < site.outer_px
        radius = radius.reshape(self._cells)
        in_image = (x >= 0) & (y >= 0) & (x < site.width_px) & (y < site.height_px)
        cell_px = radii.reshape(-1, CELL).mean(axis=1)
        self._trocar = int(cell_px.searchsorted(0))
        self._inside = (radius.max(axis=2) < site.inner_px - STEP_PX)[:, self._trocar :]
        self._outside = (radius.min(axis=2) > site.outer_px) & in_image.reshape(self._cells).all(axis=2)
        self._outside = self._outside[:, : self._trocar]
        apart_rad = FLANK_MM * site.px_per_mm / np.maximum(np.abs(cell_px), 8.0)
        apart = np.rint(np.clip(apart_rad / math.radians(STEP_DEG), 1, 2 * APART)).astype(int)
        row, column = np.mgrid[: self._cells[0], : self._cells[1]]
        first = row // len(self._angles) * len(self._angles)
        last = first + len(self._angles) - 1
        self._flanks = [
            np.clip(row + side * apart, first, last) * self._cells[1] + column for side in (-1, 1)
        ]

    def search(self, image: Image, chroma_share: float = 0.0, light: float = 1.0) -> list[Line]:
        """Return the lines most like a needle, best first.

        Args:
            image: (h, w, 3) BGR or (h, w) grey.
            chroma_share: Of blue less red in the grey within the globe.
            light: How many times brighter the image would be in good light.
        """
        unrolled = cv2.remap(image, self._map, self._none, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        grey = grey_with_chroma(np.asarray(unrolled, np.uint8), chroma_share, self._is_inside).astype(
            np.float32
        )
        cells = np.asarray(cv2.resize(grey, self._cells[1::-1], interpolation=cv2.INTER_AREA), np.float32)
        evidence = np.minimum(self._contrast(cells) * np.float32(light / CONTRAST_GREY) - 1, 1)
        score = _longest(evidence[:, : self._trocar] * self._outside)
        score += _longest(evidence[:, self._trocar :] * self._inside)
        score = score.reshape(len(self._offsets_px), len(self._angles))
        found = []
        for _ in range(CANDIDATES):
            offset, angle = divmod(int(score.argmax()), len(self._angles))
            if score[offset, angle] < LEAST_CELLS:
                break
            found.append(Line(float(self._angles[angle]), float(self._offsets_px[offset])))
            score[:, max(angle - APART, 0) : angle + APART + 1] = 0
        return found

    def _contrast(self, cells: FloatImage) -> FloatImage:
        """Return by how much every cell differs from both its sides in the same sense [grey levels]."""
        one, other = (cells - cells.take(flank) for flank in self._flanks)
        return np.asarray(np.maximum(np.minimum(one, other), -np.maximum(one, other)).clip(0), np.float32)


def _longest(evidence: FloatImage) -> FloatImage:
    """Return how much evidence there is from the first cell of every row on, up to where it is most."""
    return np.asarray(evidence.cumsum(axis=1).max(axis=1, initial=0), np.float32)
