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
MIN_SHARE = 0.7  # of half the width that a tip is off the axis: in one that is less, a cone is as probable


class Bevel:
    """The end of one needle, learned while the needle is tracked."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the needle."""
        self._images = self._slant = self._squared = self._curve = 0.0
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
        doubt, kept = slant_sd / CLEAR_SD, 1 - RATE
        weight = 1 / (1 + doubt * doubt)
        self._images = kept * self._images + weight
        self._slant = kept * self._slant + weight * slant
        self._squared = kept * self._squared + weight * slant * slant
        self._curve = kept * self._curve + weight * curve
        share = self._slant / math.hypot(self._slant, 2 * self._curve) if self._slant else 0.0
        is_bevel = self._is_slanted() and abs(share) >= MIN_SHARE
        self.off_axis_px = share * fit.width_px / 2 if is_bevel else 0.0

    def _is_slanted(self) -> bool:
        """Return whether the images agree on a slant."""
        spread = self._images * self._squared - self._slant * self._slant
        is_rigid = self._slant * self._slant >= RIGID_SD**2 * spread
        return is_rigid and abs(self._slant) >= MIN_SLANT * (self._images + DOUBT)
