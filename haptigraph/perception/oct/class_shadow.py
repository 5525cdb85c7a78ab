"""Whether a line of the needle's class is a needle: it enters the image from a border, and casts a shadow.

Metal blocks the light. So from a needle's tip to the border where it enters, no tissue is visible below it,
and beside its tip the tissue is lit. Both are tested by the network's classes and, since a network may be
wrong about a line and its shadow at once, by the image's grey.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np

from haptigraph.geometry import Vec
from haptigraph.imaging import FloatImage, Floats, Mask, grey_of
from haptigraph.messages import Image
from haptigraph.perception.oct.class_maps import Scaling

__all__ = ["SHADOW_MARGIN_MM", "Evidence", "enters_from_border"]

MAX_ENTRY_MM = 0.35  # between an image's border and the first metal that is visible
MIN_TILT_DEG = 8.0  # of a shaft to the horizontal; saturated lines and layers are flatter
SHADOW_MARGIN_MM = 0.11  # width of the shadow's soft edge beside the tip
BELOW_MM = 0.04  # the first part below a shaft's lower side, which its own brightness reaches
MIN_TISSUE_MM = 0.025  # of tissue in a column, for it to be visible there
MAX_TISSUE_SHARE = 0.12  # of the columns in a shadow, with visible tissue
BOX_MM, BOX_COLUMNS = 0.16, 4  # over which grey is averaged, less than the retina is thick
MAX_GREY_SHARE = 0.35  # of the lit tissue's contrast, in a shadow
DARK_SHARE, MIN_COLUMNS = 0.1, 3
MAX_EDGE_MM = 0.4  # from the tip to the first lit tissue beside it
MIN_LIT_GREY, HALF = 8.0, 0.5


def enters_from_border(entry_px: Vec, tip_px: Vec, size_px: tuple[int, int], scaling: Scaling) -> bool:
    """Return whether a line comes from the upper, left or right border of an image, and not too flat.

    Args:
        entry_px: Where it is first visible.
        tip_px: Its lower end.
        size_px: (width, height) of the image.
        scaling: Scale of the image.
    """
    dx, dy = tip_px[0] - entry_px[0], tip_px[1] - entry_px[1]
    run_mm, rise_mm = abs(dx) * scaling.lateral_mm, dy * scaling.axial_mm
    if rise_mm < math.tan(math.radians(MIN_TILT_DEG)) * run_mm:
        return False
    up = entry_px[1] / dy if dy > 0 else math.inf
    beside_px = entry_px[0] if dx > 0 else size_px[0] - 1 - entry_px[0]
    beside = beside_px / abs(dx) if dx else math.inf
    return max(min(up, beside), 0.0) * math.hypot(run_mm, rise_mm) <= MAX_ENTRY_MM


class _Columns(NamedTuple):
    """Visible tissue and grey by column of the map, (w,) each."""

    has_tissue: Mask
    grey: Floats
    """Brightest average over a box."""


class Evidence:
    """Tissue and grey of one image, to test lines against.

    Args:
        image: The image, (h, w) or (h, w, 3).
        tissue: Probability of tissue that is visible only in the light, (h, w) of the map.
        scaling: From map to image.
    """

    def __init__(self, image: Image, tissue: FloatImage, scaling: Scaling) -> None:
        self._tissue, self._scaling = tissue, scaling
        height, width = tissue.shape
        smaller = cv2.resize(grey_of(image), (width, height), interpolation=cv2.INTER_AREA)
        box = BOX_COLUMNS, max(2, round(BOX_MM / scaling.row_mm))
        self._grey = cv2.blur(smaller.astype(np.float32), box, borderType=cv2.BORDER_REPLICATE)
        self._whole = self._between(-1.0, np.inf)
        self._dark_grey = float(np.quantile(self._grey[::2, ::2], DARK_SHARE))

    def casts_shadow(self, entry_px: Vec, tip_px: Vec) -> bool:
        """Return whether a line casts a shadow that ends beside its tip.

        Args:
            entry_px: Where it is first visible, in pixels of the image.
            tip_px: Its lower end.
        """
        if not self._whole.has_tissue.any():
            return True  # there is nothing on which a shadow could fall
        scaling = self._scaling
        dx, dy = tip_px[0] - entry_px[0], tip_px[1] - entry_px[1]
        side = math.copysign(1.0, dx)
        x_px = (np.arange(self._tissue.shape[1]) + 0.5) * scaling.across - 0.5
        behind_mm = side * (tip_px[0] - x_px) * scaling.lateral_mm
        shaft_px = tip_px[1] + (dy / dx if dx else math.inf) * -side * behind_mm / scaling.lateral_mm
        covered = behind_mm > SHADOW_MARGIN_MM
        if covered.sum() < MIN_COLUMNS:
            return False
        steep = abs(dy / dx) * scaling.across / scaling.down if dx else 0.0
        beside_rows = (BELOW_MM + BOX_MM / 2) / scaling.row_mm + (BOX_COLUMNS / 2 + 1) * steep
        shaft_row = np.maximum(shaft_px, 0) / scaling.down
        below = self._between(shaft_row + beside_rows, np.inf)
        above = self._between(-1.0, shaft_row - beside_rows)
        beyond_mm = -behind_mm[self._whole.has_tissue & (behind_mm < SHADOW_MARGIN_MM)]
        if not len(beyond_mm) or float(beyond_mm.min()) > MAX_EDGE_MM:
            return False
        lit = self._whole.has_tissue & ~covered
        lit_grey = float(np.median(self._whole.grey[lit])) - self._dark_grey
        lit_grey = self._dark_grey + MAX_GREY_SHARE * max(lit_grey, MIN_LIT_GREY)
        first = covered & (behind_mm >= float(np.median(behind_mm[covered])))  # nearer to the border
        is_bright = below.grey > lit_grey
        return (
            float((below.has_tissue & is_bright)[covered].mean()) <= MAX_TISSUE_SHARE
            and float(is_bright[covered].mean()) < HALF
            and float((above.has_tissue & (above.grey > lit_grey))[first].mean()) <= MAX_TISSUE_SHARE
        )

    def _between(self, first_row: Floats | float, end_row: Floats | float) -> _Columns:
        """Return tissue and grey of each column between two rows, (w,)."""
        rows = np.arange(len(self._tissue))[:, None]
        is_inside = (rows > first_row) & (rows < end_row)
        tissue_mm = np.where(is_inside, self._tissue, 0).sum(axis=0) * self._scaling.row_mm
        grey = np.where(is_inside, self._grey, 0).max(axis=0)
        return _Columns(tissue_mm >= MIN_TISSUE_MM, np.asarray(grey, np.float64))
