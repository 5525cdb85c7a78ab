"""How far off the shaft's axis a needle's tip is: a bevel's is, by up to half the needle's width.

Turns how the shaft's end is cut (`native/end_slant.c`), image by image, into one offset. Clear images count
more. A cone has a curve, a round or blunt end no slant, and motion blur slants an end a little.
"""

import math

from haptigraph.perception.native.strip import end_slant
from haptigraph.perception.needle.rectify import RectifiedStrip
from haptigraph.perception.needle.shaft_line import LineFit

__all__ = ["Bevel"]

RATE = 0.1  # weight of an image among those before it
DOUBT = 1.0  # how many clear images without a slant are assumed
CLEAR_SD = 0.2  # widths: sd of the slant in a clear image
MIN_SLANT = 0.7  # widths over the whole width,
RIGID_SD = 2.0  # and so many of its standard deviations from image to image: a bevel is rigid
MIN_SHARE = 0.7  # of half the width, off the axis: a tip that is nearer to it may as well be a cone's


class Bevel:
    """The end of one needle, learned while the needle is tracked."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the needle."""
        self._sums: tuple[float, ...] = (0.0,) * 4
        self.off_axis_px = 0.0
        """How far the tip is off the axis, along the normal; 0 unless it clearly is a bevel's."""

    def learn(self, strip: RectifiedStrip, tip_px: float, fit: LineFit) -> None:
        """Learn from one image.

        Args:
            strip: The strip along the shaft.
            tip_px: The tip along it.
            fit: The shaft's line.
        """
        found = end_slant(strip, (fit.offset_px, fit.slope), tip_px, fit.width_px)
        if found is None:
            return
        slant, curve, slant_sd = found
        doubt = slant_sd / CLEAR_SD
        weight, kept = 1 / (1 + doubt * doubt), 1 - RATE
        new = 1.0, slant, slant * slant, curve
        images, slants, squares, curves = self._sums = tuple(
            kept * before + weight * value for before, value in zip(self._sums, new, strict=True)
        )
        is_slanted = abs(slants) >= MIN_SLANT * (images + DOUBT)
        is_rigid = slants * slants >= RIGID_SD**2 * (images * squares - slants * slants)
        share = slants / math.hypot(slants, 2 * curves) if slants else 0.0
        is_bevel = is_slanted and is_rigid and abs(share) >= MIN_SHARE
        self.off_axis_px = share * fit.width_px / 2 if is_bevel else 0.0
