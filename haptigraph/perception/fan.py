"""Acquisition: a search for the needle along one number, the angle at which it leaves the trocar.

Turns an image into a few candidate lines. The image is unrolled about the trocar (angle x radius), where
every needle is a straight row; a row counts that differs from both its sides without a gap, inwards from
the wall or from the far end of the shaft towards it. Knows nothing of earlier images, and does not decide.
"""

import math

import cv2
import numpy as np

from haptigraph.messages import Image
from haptigraph.perception.pixels import FloatImage, grey_of
from haptigraph.perception.strip import OUTSIDE_MM, Line, Site

__all__ = ["Fan"]

STEP_DEG = 0.75
REACH_DEG = 46.0
STEP_PX = 2.0
CELL = 4
LONGEST_MM = 25.0
FLANK_MM = 0.6
CONTRAST_GREY = 6.0
LEAST_CELLS = 2.0
CANDIDATES = 3
APART = 6  # rows of the fan between two candidates


class Fan:
    """The unrolled image about one trocar.

    Args:
        site: Where trocar and globe are.
    """

    def __init__(self, site: Site) -> None:
        reach = round(REACH_DEG / STEP_DEG)
        self._angles = site.inwards_rad + np.radians(STEP_DEG) * np.arange(-reach, reach + 1)
        radii = np.arange(-OUTSIDE_MM * site.px_per_mm, LONGEST_MM * site.px_per_mm, STEP_PX)
        radii = radii[: len(radii) // CELL * CELL]
        x = site.trocar_px[0] + radii * np.cos(self._angles)[:, None]
        y = site.trocar_px[1] + radii * np.sin(self._angles)[:, None]
        self._map, self._map_share = cv2.convertMaps(x.astype(np.float32), y.astype(np.float32), cv2.CV_16SC2)
        self._cells = len(self._angles), len(radii) // CELL, CELL
        radius = np.hypot(x - site.center_px[0], y - site.center_px[1]).reshape(self._cells)
        in_image = (x >= 0) & (y >= 0) & (x < site.width_px) & (y < site.height_px)
        cell_px = radii.reshape(-1, CELL).mean(axis=1)
        self._inside = (radius.max(axis=2) < site.inner_px - STEP_PX) & (cell_px > 0)
        self._outside = (radius.min(axis=2) > site.outer_px) & (cell_px < 0)
        self._outside &= in_image.reshape(self._cells).all(axis=2)
        apart_rad = FLANK_MM * site.px_per_mm / np.maximum(np.abs(cell_px), 8.0)
        apart = np.clip(apart_rad / math.radians(STEP_DEG), 1, 2 * APART)
        row, column = np.mgrid[: self._cells[0], : self._cells[1]].astype(np.float32)
        self._flanks = [((row + side * apart).astype(np.float32), column) for side in (-1, 1)]

    def search(self, image: Image) -> list[Line]:
        """Return the lines through the trocar most like a needle, best first."""
        unrolled = cv2.remap(
            image, self._map, self._map_share, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        cells = grey_of(np.asarray(unrolled, np.uint8)).reshape(self._cells).mean(axis=2, dtype=np.float32)
        evidence = np.clip(self._contrast(cells) / CONTRAST_GREY - 1, -1, 1)
        within = np.cumsum(evidence * self._inside, axis=1).max(axis=1)
        before = np.cumsum(evidence * self._outside, axis=1).max(axis=1)
        score = np.maximum(within, 0) + np.maximum(before, 0)
        found = []
        for _ in range(CANDIDATES):
            best = int(score.argmax())
            if score[best] < LEAST_CELLS:
                break
            found.append(Line(float(self._angles[best]), 0.0))
            score[max(best - APART, 0) : best + APART + 1] = 0
        return found

    def _contrast(self, cells: FloatImage) -> FloatImage:
        """Return by how much every cell differs from both its sides in the same sense [grey levels]."""
        one, other = (
            cells - cv2.remap(cells, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for row, column in self._flanks
        )
        least = np.minimum(np.abs(one), np.abs(other))
        return np.asarray(np.where(one * other > 0, least, 0), np.float32)
