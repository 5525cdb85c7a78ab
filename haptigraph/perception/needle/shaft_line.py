"""The shaft's middle line, with its covariance.

Turns a rectified strip into a line by inverse-variance-weighted least squares: `native/edges.c` detects the
shaft's edges, `native/shaft_line.c` fits a line to their middles.
"""

import math

import numpy as np
from msgspec import Struct

from haptigraph.imaging import FloatImage, Mask
from haptigraph.perception.native import strip as native
from haptigraph.perception.needle.rectify import STATION_PX, RectifiedStrip

__all__ = ["BLOCK_PX", "NEW", "Appearance", "LineFit", "fit_line"]

BLOCK_PX = native.BLOCK * STATION_PX
"""From block to block."""

MIN_BESIDE = 0.2  # of the blocks beside the wall
RUN = b"\1\1\1"  # fewer steep blocks in a row may be noise


class Appearance(Struct, frozen=True):
    """What earlier images showed of a needle's appearance."""

    highlight: tuple[float, float] | None = None
    """Offset of the specular highlight from the axis, as a share of its pair's width, and the standard
    deviation of that; None if no bright line was ever visible within a darker shaft."""
    images: int = 0
    """Since a line fitted feet of edges better than edges, or the needle appeared."""
    shaded_px: tuple[float | None, float | None] = (None, None)
    """Shift of the middle by an edge that fades into the shade, outside and inside; None if unknown."""


NEW = Appearance()
"""Of a needle that has just appeared."""


class LineFit(Struct, frozen=True, eq=False):
    """A straight line across a strip: v = offset_px + slope u."""

    offset_px: float
    slope: float
    covariance: tuple[float, float, float]
    """Of (offset_px, offset_px), (offset_px, slope) and (slope, slope): by noise, other in every image."""
    light_rad: float
    """Standard deviation of its angle by the light on the metal, the same in every image."""
    width_px: float
    """Of the shaft, a median."""
    blur_px: float
    """Standard deviation of the blur across its edges, a median: by the lens, and by light on round metal."""
    confidence: float
    """Share of the blocks that show both edges on the line."""
    appearance: Appearance
    u_px: FloatImage
    """Middle of each block along the strip, (n,)."""
    is_on_line: Mask
    """Blocks whose edges agree with the line, (n,)."""
    is_steep: bytes
    """1 for each block with edges by the line too steep for the needle's shadow, else 0."""

    def leads_through(self, wall_px: float) -> bool:
        """Return whether steep edges are right before the wall, or enough of them beyond it.

        A shaft whose last edges before the wall are not steep, and none beyond it, ends before it.
        """
        wall = int(self.u_px.searchsorted(wall_px))
        before, beyond = self.is_steep[max(wall - len(RUN), 0) : wall], self.is_steep[wall:]
        ends_before = before.endswith(b"\0") and len(beyond) >= len(RUN) and 1 not in beyond
        return beyond.count(1) >= len(RUN) or (before.count(1) >= 2 and not ends_before)

    def is_beside(self, wall_px: float, within_px: float) -> bool:
        """Return whether the line shows beside the wall, on either side of it."""
        is_near = np.abs(self.u_px - wall_px) < within_px
        return int(np.count_nonzero(self.is_on_line & is_near)) >= MIN_BESIDE * int(np.count_nonzero(is_near))

    def is_unbroken(self, from_px: float, to_px: float) -> bool:
        """Return whether steep edges are everywhere between two positions along the strip."""
        first, last = self.u_px.searchsorted((from_px + BLOCK_PX, to_px - BLOCK_PX / 2))
        return last - first >= len(RUN) - 1 and self.is_steep.count(0, int(first), int(last)) == 0

    def end_px(self, from_px: float) -> float:
        """Return how far along the strip there are steep edges: the end of the last unbroken run."""
        run = self.is_steep.rfind(RUN, int(self.u_px.searchsorted(from_px)))
        return (from_px if run < 0 else float(self.u_px[run + len(RUN) - 1])) + BLOCK_PX


def fit_line(
    strip: RectifiedStrip, tip_px: float, miss_px: float, appearance: Appearance = NEW
) -> LineFit | None:
    """Fit the shaft's middle line to all that is visible of it before the tip.

    Args:
        strip: The strip.
        tip_px: Approximate tip.
        miss_px: How far the shaft may be from the strip's middle.
        appearance: What earlier images showed of this needle.

    Returns:
        The line, or None if too few blocks show two edges on one line.
    """
    found = native.fit_line(strip, tip_px, miss_px, _to_numbers(appearance))
    if found is None:
        return None
    numbers, u_px, is_on_line, is_steep = found
    offset_px, slope, offset_px2, both, slope2, light_rad, width_px, blur_px, _, *others = numbers
    *shown, blocks, on_line, _ = others
    return LineFit(
        *(offset_px, slope, (offset_px2, both, slope2), light_rad, width_px, blur_px, on_line / blocks),
        *(_from_numbers(shown), u_px, is_on_line, is_steep),
    )


def _to_numbers(appearance: Appearance) -> list[float]:
    """Return an appearance as C has it, (5,): with nan for None."""
    highlight = appearance.highlight or (math.nan, math.nan)
    return [*highlight, appearance.images, *(math.nan if px is None else px for px in appearance.shaded_px)]


def _from_numbers(numbers: list[float]) -> Appearance:
    share, share_sd, images, *shaded_px = numbers
    outside_px, inside_px = (None if math.isnan(px) else px for px in shaded_px)
    highlight = None if math.isnan(share) else (share, share_sd)
    return Appearance(highlight, int(images), (outside_px, inside_px))
