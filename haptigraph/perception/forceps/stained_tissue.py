"""Tissue detected by its colour: a blue-stained membrane with its loose edge, and blood on the retina.

Turns an image (px) into positions (eye frame, mm), and into an image without the dye, because a stained
membrane that is pulled looks like a continuation of the shaft. Every image is processed independently;
occluded tissue is not reported.
"""

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.geometry import Circle, Geometry, Point, nearest_on_polyline, norm, subtract
from haptigraph.imaging import Mask
from haptigraph.messages import Image
from haptigraph.perception.native.pixels import Marked, Region, fill_marked, mark_stains
from haptigraph.registration.camera import Registration

__all__ = ["StainedTissue"]

BLUE_GREY = 22  # excess of blue over the other colours in dye
RED_GREY = 60  # excess of red in blood; a fundus and its vessels have less
MIN_DYE_MM2 = 0.25
MIN_BLOOD_MM2 = 0.5
SPECK_MM2 = 0.02
TOP_MM = 0.12  # extent of the edge below the membrane's highest point
RIM_MM = 0.1
SPREAD_PX = 5  # blur of coloured regions: cameras and codecs resolve colour less finely
FILL_MM = 2.0  # width of the surroundings from which dye is filled


class _Stain(Struct, frozen=True, eq=False):
    """Stained pixels of the globe's box."""

    part: Mask
    """Those within its bounding box."""
    within: Region

    def pixels(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return rows and columns of its pixels in the globe's box."""
        rows, columns = self.part.nonzero()
        return rows + self.within[0].start, columns + self.within[1].start


class StainedTissue:
    """Detect coloured tissue in images of one registration.

    Args:
        registration: Geometry of globe and retina.
    """

    def __init__(self, registration: Registration) -> None:
        image, radius_mm = registration.image, registration.globe.radius_mm
        self._registration, self._px_per_mm = registration, 1 / image.mm_per_px
        (x, y), reach = image.center_px, radius_mm / image.mm_per_px
        self._box = (
            slice(max(round(y), 0), min(round(y + reach) + 1, registration.height_px)),
            slice(max(round(x - reach), 0), min(round(x + reach) + 1, registration.width_px)),
        )
        rows, columns = self._box
        row, column = np.ogrid[rows, columns]
        self._above_mm = (radius_mm - np.hypot(column - x, row - y) * image.mm_per_px).astype(np.float32)
        inside = self._above_mm > RIM_MM
        last = inside.shape[1] - inside[:, ::-1].argmax(axis=1)
        ends = np.where(inside.any(axis=1), (inside.argmax(axis=1), last), 0)
        self._spans = np.ascontiguousarray(ends.T, np.int32)  # columns of each row within the globe
        self._dye, self._blood = np.empty((2, *inside.shape), np.bool_)
        self._undyed = np.empty((registration.height_px, registration.width_px, 3), np.uint8)

    def __call__(self, image: Image) -> tuple[dict[str, Geometry], Image]:
        """Process one image.

        Args:
            image: (h, w, 3) BGR or (h, w) grey, in which no tissue is detected.

        Returns:
            `membrane_edge` (point) and `hemorrhage` (circle, as wide as the blood), if they are visible; and
            the image with the dye filled from its surroundings, which the next call overwrites.
        """
        if image.ndim == 2:
            return {}, image
        found: dict[str, Geometry] = {}
        planes = self._spans, self._dye, self._blood
        dyed, bloody = mark_stains(image, self._box, BLUE_GREY, RED_GREY, *planes)
        if (stain := self._stain(self._dye, dyed, MIN_DYE_MM2)) is not None:
            found["membrane_edge"] = self._edge(stain)
            image = self._without_dye(image, stain)
        if (stain := self._stain(self._blood, bloody, MIN_BLOOD_MM2)) is not None:
            found["hemorrhage"] = self._region(stain)
        return found, image

    def _stain(self, mask: Mask, marked: Marked, min_mm2: float) -> _Stain | None:
        """Return marked pixels without specks; None if there are too few."""
        if marked.count < min_mm2 * self._px_per_mm**2:
            return None
        _, parts, facts, _ = cv2.connectedComponentsWithStats(mask[marked.within].view(np.uint8))
        is_large = facts[:, cv2.CC_STAT_AREA] >= SPECK_MM2 * self._px_per_mm**2
        is_large[0] = False
        part = is_large[parts]
        area_mm2 = float(np.count_nonzero(part)) / self._px_per_mm**2
        return _Stain(part, marked.within) if area_mm2 >= min_mm2 else None

    def _without_dye(self, image: Image, dye: _Stain) -> Image:
        """Return an image with the dye filled from its surroundings."""
        width = max(round(FILL_MM * self._px_per_mm), SPREAD_PX) | 1
        (height, columns), (rows, across) = self._dye.shape, dye.within
        margin = width // 2 + SPREAD_PX // 2  # as far as pixels are averaged about those that are filled
        about = (
            slice(max(rows.start - margin, 0), min(rows.stop + margin, height)),
            slice(max(across.start - margin, 0), min(across.stop + margin, columns)),
        )
        dyed = np.zeros((about[0].stop - about[0].start, about[1].stop - about[1].start), np.uint8)
        top, left = rows.start - about[0].start, across.start - about[1].start
        dyed[top : top + dye.part.shape[0], left : left + dye.part.shape[1]] = dye.part
        dyed = cv2.dilate(dyed, np.ones((SPREAD_PX, SPREAD_PX), np.uint8))
        np.copyto(self._undyed, image)
        (box_rows, box_columns), (first, last) = self._box, about
        region = (
            slice(box_rows.start + first.start, box_rows.start + first.stop),
            slice(box_columns.start + last.start, box_columns.start + last.stop),
        )
        fill_marked(image, region, dyed.view(np.bool_), width // 2, self._undyed)
        return self._undyed

    def _edge(self, dye: _Stain) -> Point:
        """Return the highest point above the retina."""
        rows, columns = dye.pixels()
        height_mm = self._above_mm[rows, columns]
        is_top = height_mm >= height_mm.max() - TOP_MM
        return Point(self._to_mm(float(columns[is_top].mean()), float(rows[is_top].mean())))

    def _region(self, blood: _Stain) -> Circle:
        """Return the circle around the blood's centre on the retina, as wide as the blood."""
        rows, columns = blood.pixels()
        retina = self._registration.retina
        middle = nearest_on_polyline(self._to_mm(float(columns.mean()), float(rows.mean())), retina)
        ends = (int(columns.argmin()), int(columns.argmax()))
        reach_mm = [
            norm(subtract(self._to_mm(float(columns[end]), float(rows[end])), middle)) for end in ends
        ]
        return Circle(middle, sum(reach_mm) / 2)

    def _to_mm(self, column: float, row: float) -> tuple[float, float]:
        rows, columns = self._box
        return self._registration.image.to_mm((column + columns.start, row + rows.start))
