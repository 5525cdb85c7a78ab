"""Tissue detected by its colour: a blue-stained membrane with its loose edge, and blood on the retina.

Turns an image (px) into positions (eye frame, mm), and into an image without the dye, because a stained
membrane that is pulled looks like a continuation of the shaft. Every image is processed independently;
occluded tissue is not reported.
"""

import cv2
import numpy as np

from haptigraph.geometry import Circle, Geometry, Point, nearest_on_polyline, norm, subtract
from haptigraph.imaging import Mask
from haptigraph.messages import Image
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
        self._inside = self._above_mm > RIM_MM

    def __call__(self, image: Image) -> tuple[dict[str, Geometry], Image]:
        """Process one image.

        Args:
            image: (h, w, 3) BGR or (h, w) grey, in which no tissue is detected.

        Returns:
            `membrane_edge` (point) and `hemorrhage` (circle, as wide as the blood), if they are visible; and
            the image with the dye filled from its surroundings.
        """
        if image.ndim == 2:
            return {}, image
        blue, green, red = cv2.split(image[self._box])
        found: dict[str, Geometry] = {}
        dye = self._without_specks(cv2.subtract(blue, cv2.max(green, red)) > BLUE_GREY)
        if self._area_mm2(dye) >= MIN_DYE_MM2:
            found["membrane_edge"] = self._edge(dye)
            image = self._without_dye(image, dye)
        blood = self._without_specks(cv2.subtract(red, cv2.max(green, blue)) > RED_GREY)
        if self._area_mm2(blood) >= MIN_BLOOD_MM2:
            found["hemorrhage"] = self._region(blood)
        return found, image

    def _without_specks(self, stained: Mask) -> Mask:
        """Remove specks and everything outside the globe, in place."""
        stained &= self._inside
        x, y, width, height = cv2.boundingRect(stained.view(np.uint8))
        part = stained[y : y + height, x : x + width]
        if part.size:
            _, parts, facts, _ = cv2.connectedComponentsWithStats(part.view(np.uint8))
            is_large = facts[:, cv2.CC_STAT_AREA] >= SPECK_MM2 * self._px_per_mm**2
            is_large[0] = False
            part &= is_large[parts]
        return stained

    def _without_dye(self, image: Image, dye: Mask) -> Image:
        """Return an image with the dye filled from its surroundings."""
        cleaned, width = image.copy(), max(round(FILL_MM * self._px_per_mm), SPREAD_PX) | 1
        x, y, columns, rows = cv2.boundingRect(dye.view(np.uint8))
        about = slice(max(y - width, 0), y + rows + width), slice(max(x - width, 0), x + columns + width)
        part = cleaned[self._box][about]
        dyed = cv2.dilate(dye[about].view(np.uint8), np.ones((SPREAD_PX, SPREAD_PX), np.uint8))
        free = (dyed == 0).astype(np.float32)
        share = cv2.blur(free, (width, width))
        light = cv2.blur(part * free[..., None], (width, width))
        fill = light / np.maximum(share, np.float32(1e-3))[..., None]
        is_filled = (dyed > 0) & (share > 0)
        part[is_filled] = fill[is_filled]
        return cleaned

    def _area_mm2(self, part: Mask) -> float:
        return float(np.count_nonzero(part)) / self._px_per_mm**2

    def _edge(self, dye: Mask) -> Point:
        """Return the highest point above the retina."""
        rows, columns = np.nonzero(dye)
        height_mm = self._above_mm[rows, columns]
        is_top = height_mm >= height_mm.max() - TOP_MM
        return Point(self._to_mm(float(columns[is_top].mean()), float(rows[is_top].mean())))

    def _region(self, blood: Mask) -> Circle:
        """Return the circle around the blood's centre on the retina, as wide as the blood."""
        rows, columns = np.nonzero(blood)
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
