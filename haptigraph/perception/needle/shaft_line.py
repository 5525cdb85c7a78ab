"""The shaft's middle line: where the middles of its edges lie, weighed by how sure they are.

Turns a strip into a line with its covariance: `native/edges.c` finds the edges, `native/shaft_line.c` fits
a line to them. Knows no trocar and no time.
"""

import ctypes
import math

import numpy as np
from msgspec import Struct

from haptigraph.imaging import FloatImage, Mask
from haptigraph.perception.native.library import address, function
from haptigraph.perception.needle.rectify import STATION_PX, RectifiedStrip

__all__ = ["BLOCK_PX", "NEW", "Appearance", "LineFit", "fit_line"]

BLOCK = 3  # stations that are looked at together, as in edges.h
BLOCK_PX = BLOCK * STATION_PX
"""From block to block."""

RUN = b"\1\1\1"  # fewer blocks in a row tell nothing

_Seen, _Told = ctypes.c_double * 5, ctypes.c_double * 13
_fit_line = function("fit_line", "pddppppp", ctypes.c_int)


class Appearance(Struct, frozen=True):
    """What earlier images told of how a needle looks."""

    highlight: tuple[float, float] | None = None
    """How far a bright line on the metal runs beside its axis, as a share of that line's width, and the
    deviation of that; None if no bright line within a darker shaft was ever seen."""
    images: int = 0
    """Since edges lay on a line better by their feet, or the needle came."""
    shaded_px: tuple[float | None, float | None] = (None, None)
    """How far off the middle is before the wall and inside, for one edge fades; None if never told."""


NEW = Appearance()
"""Of a needle that has just come."""


class LineFit(Struct, frozen=True, eq=False):
    """A straight line across a strip: v = offset_px + slope u."""

    offset_px: float
    slope: float
    covariance: tuple[float, float, float]
    """Of (offset_px, offset_px), (offset_px, slope) and (slope, slope)."""
    width_px: float
    """Of the shaft, a median."""
    blur_px: float
    """Deviation of the blur across its edges, a median: of the lens, and of how round metal is lit."""
    confidence: float
    """Share of the blocks that show both edges on the line."""
    look: Appearance
    u_px: FloatImage
    """Middle of every block along the strip, (n,)."""
    is_on_line: Mask
    """Blocks whose edges agree with the line, (n,)."""
    is_steep: bytes
    """Of every block 1 if it has edges near the line that are steep enough to be the needle's and not its
    shadow's, else 0."""

    def leads_through(self, wall_px: float) -> bool:
        """Tell whether edges lie by the line right before the wall, or enough of them beyond it."""
        beyond = int(self.u_px.searchsorted(wall_px))
        before = max(beyond - len(RUN), 0)
        return self.is_steep.count(1, before, beyond) >= 2 or self.is_steep.count(1, beyond) >= len(RUN)

    def end_px(self, from_px: float) -> float:
        """Return how far along the strip there are edges by the line: the end of the last unbroken run."""
        run = self.is_steep.rfind(RUN, int(self.u_px.searchsorted(from_px)))
        return (from_px if run < 0 else float(self.u_px[run + len(RUN) - 1])) + BLOCK_PX


def fit_line(strip: RectifiedStrip, tip_px: float, miss_px: float, look: Appearance = NEW) -> LineFit | None:
    """Fit the shaft's middle line to all that is visible of it before the tip.

    Args:
        strip: The straightened surroundings.
        tip_px: Where the needle ends, roughly.
        miss_px: How far the shaft may be from the strip's middle.
        look: What earlier images told of this needle.

    Returns:
        The line, or None if too few blocks show two edges that lie on one.
    """
    most = len(strip.u_px) // BLOCK + 1
    u_px, masks, told = np.empty(most, np.float32), np.empty((2, most), np.bool_), _Told()
    of_masks = address(masks)
    blocks = _fit_line(
        *(strip.native, tip_px, miss_px, _Seen(*_numbers(look)), told),
        *(address(u_px), of_masks, of_masks + most),
    )
    if blocks < 0:
        raise MemoryError
    if not blocks:
        return None
    offset_px, slope, offset_px2, both, slope2, width_px, blur_px, confidence = told[:8]
    return LineFit(
        *(offset_px, slope, (offset_px2, both, slope2), width_px, blur_px, confidence, _look(told[8:])),
        *(u_px[:blocks], masks[0, :blocks], masks[1, :blocks].tobytes()),
    )


def _numbers(look: Appearance) -> list[float]:
    """Return a look as C has it, (5,): with nan for None."""
    highlight = look.highlight or (math.nan, math.nan)
    return [*highlight, look.images, *(math.nan if px is None else px for px in look.shaded_px)]


def _look(numbers: list[float]) -> Appearance:
    share, share_sd, images, *shaded_px = numbers
    outside_px, inside_px = (None if math.isnan(px) else px for px in shaded_px)
    highlight = None if math.isnan(share) else (share, share_sd)
    return Appearance(highlight, int(images), (outside_px, inside_px))
