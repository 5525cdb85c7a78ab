"""The jaws at the end of a forceps' shaft: the metal connected to the shaft, and its end on either side.

Turns an image and the shaft's line into the tips of two jaws (px). Metal differs from the background and is
achromatic, so that stained tissue between the jaws is not mistaken for them.
"""

import math
from typing import Any

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.geometry import Vec, norm, subtract, unit
from haptigraph.imaging import FloatImage, Mask, grey_with_chroma
from haptigraph.messages import Image
from haptigraph.perception.native import jaws as native
from haptigraph.perception.needle.rectify import median

__all__ = ["HALF_WIDTH_MM", "Jaws", "find_jaws"]

ABOUT_MM = 6.0  # of the rectified patch, before and beyond the shaft's visible end; jaws are no longer
FLANK_MM = 0.25
SHAFT_MM = 0.15  # smallest half width of a shaft
MAX_SHAFT_MM = 0.7
MAX_DIFFERENCE_MM = 0.7
MIN_LENGTH_MM = 0.6  # of metal inside the wall
RIM_PX = 2.0
OTHER_MM = 1.0  # width of another instrument including blur

HALF_WIDTH_MM = 1.7
"""Of the rectified patch; jaws open no wider."""


class Jaws(Struct, frozen=True):
    """The tips of two jaws [px]."""

    one_px: Vec
    """On the side of the shaft's direction into the eye rotated by +90 degrees (x towards y)."""
    other_px: Vec


class _Patch(Struct, frozen=True, eq=False):
    """A rectified part of the image: stations along the shaft, lanes across it, one pixel each."""

    first_px: Vec
    along: Vec
    size: tuple[int, int]
    """(stations, lanes)."""

    @property
    def half(self) -> int:
        """The lane of the shaft's line."""
        return self.size[1] // 2

    def rectify(self, image: NDArray[Any]) -> NDArray[Any]:
        """Resample this part of an image, (lanes, stations, ...)."""
        (dx, dy), (x, y) = self.along, self.first_px
        matrix = np.array([[dx, -dy, x + self.half * dy], [dy, dx, y - self.half * dx]])
        flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        return cv2.warpAffine(image, matrix, self.size, flags=flags, borderMode=cv2.BORDER_REPLICATE)

    def to_image(self, station_px: float, lane_px: float) -> Vec:
        """Convert a point of the patch to the image [px]."""
        (dx, dy), across = self.along, lane_px - self.half
        return (
            self.first_px[0] + station_px * dx - across * dy,
            self.first_px[1] + station_px * dy + across * dx,
        )

    def to_patch(self, at_px: Vec) -> Vec:
        """Convert a point of the image [px] to (station, lane)."""
        (dx, dy), (x, y) = self.along, subtract(at_px, self.first_px)
        return x * dx + y * dy, y * dx - x * dy + self.half


def find_jaws(
    image: Image,
    background: FloatImage,
    entry_px: Vec,
    visible_to_px: Vec,
    *,
    px_per_mm: float,
    globe: tuple[Vec, float],
    chroma_share: float = 0.0,
    other: tuple[Vec, Vec] | None = None,
) -> Jaws | None:
    """Find the jaws of one pair of forceps.

    Args:
        image: (h, w, 3) BGR or (h, w) grey.
        background: The eye without instruments, (h, w) grey; negative where unknown.
        entry_px: Where the shaft emerges from the wall.
        visible_to_px: Another point on its centre line, up to which it is certainly visible.
        px_per_mm: Scale.
        globe: Centre and inner radius [px].
        chroma_share: Weight of blue minus red in the grey of `background`.
        other: The two ends of another instrument [px], which is ignored.

    Returns:
        The jaws, or None if no metal is found along the line.
    """
    (center_px, radius_px), along = globe, unit(subtract(visible_to_px, entry_px))
    visible_px, about_px = norm(subtract(visible_to_px, entry_px)), ABOUT_MM * px_per_mm
    skipped_px = max(visible_px - about_px, 0.0)
    first_px = entry_px[0] + skipped_px * along[0], entry_px[1] + skipped_px * along[1]
    visible_px -= skipped_px
    inwards = subtract(center_px, first_px)
    middle = inwards[0] * along[0] + inwards[1] * along[1]
    aside = abs(inwards[0] * along[1] - inwards[1] * along[0])
    if aside >= radius_px:
        return None
    reach_px = min(middle + math.sqrt(radius_px**2 - aside**2), visible_px + about_px)
    patch = _Patch(first_px, along, (max(round(reach_px), 1), 2 * round(HALF_WIDTH_MM * px_per_mm) + 1))
    return _jaws_in(patch, image, background, visible_px, px_per_mm, globe, chroma_share, other)


def _jaws_in(
    patch: _Patch,
    image: Image,
    background: FloatImage,
    visible_px: float,
    px_per_mm: float,
    globe: tuple[Vec, float],
    chroma_share: float,
    other: tuple[Vec, Vec] | None,
) -> Jaws | None:
    """Find the jaws in the patch along the shaft."""
    pixels, expected = patch.rectify(image), patch.rectify(background)
    grey = grey_with_chroma(pixels, chroma_share, np.True_)
    flank = max(round(FLANK_MM * px_per_mm), 2)
    beside = np.concatenate([grey[:flank], grey[-flank:]])
    is_known = expected >= 0
    if not is_known.all():
        expected = np.where(is_known, expected, np.median(beside, axis=0).astype(np.float32))
    gain = median(beside) / max(median(np.concatenate([expected[:flank], expected[-flank:]])), 1.0)
    center_px, radius_px = globe
    tips = native.find_jaws(
        grey,
        pixels if image.ndim == 3 else None,
        expected,
        gain,
        core_px=max(round(SHAFT_MM * px_per_mm), 1),
        visible_px=min(max(round(visible_px), 1), patch.size[0]),
        globe=(patch.to_patch(center_px), radius_px - RIM_PX),
        is_other=None if other is None else _stripe(patch, other, px_per_mm),
        min_length_px=MIN_LENGTH_MM * px_per_mm,
        max_difference_px=MAX_DIFFERENCE_MM * px_per_mm,
    )
    return None if tips is None else Jaws(*(patch.to_image(*tip) for tip in tips))


def _stripe(patch: _Patch, ends: tuple[Vec, Vec], px_per_mm: float) -> Mask:
    """Return the pixels of another instrument, except where the shaft itself may be."""
    lanes, stations = patch.size[::-1]
    stripe = np.zeros((lanes, stations), np.uint8)
    one, two = (tuple(round(value) for value in patch.to_patch(end)) for end in ends)
    cv2.line(stripe, one, two, 1, max(round(OTHER_MM * px_per_mm), 1))
    kept = round(MAX_SHAFT_MM / 2 * px_per_mm)
    stripe[patch.half - kept : patch.half + kept + 1] = 0
    return stripe.view(np.bool_)
