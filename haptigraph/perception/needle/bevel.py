"""How far off the shaft's axis a needle's tip is: a bevel's is, by up to half the needle's width.

Turns a shaft and its tip patch, image by image, into one offset. The last bit of a point is narrow, so its
middle does not depend on how the metal is lit. The middle of a blunt end does, and so does that of the shaft
behind it: where both are alike, there is no bevel.
"""

import math

from haptigraph.perception.native.sharpness import is_sharp
from haptigraph.perception.native.strip import contrast_centroid
from haptigraph.perception.needle.rectify import RectifiedStrip
from haptigraph.perception.needle.shaft_line import LineFit

__all__ = ["Bevel"]

POINT = 2  # stations before the tip that are measured
BEHIND = 5.0, 3.0  # widths behind the tip, from where to where the shaft is whole
MIN_BEHIND = 3  # stations
MARGIN_PX = 1.0  # of blur beside the shaft
SHARP_SHARE = 0.2  # of its contrast: a shadow beside the tip is less sharp
RATE, DOUBT_RATE = 0.2, 0.05  # weight of one image with a bevel, and of one without
MIN_PX = 1.0  # off the axis, and off the middle of what is behind


class Bevel:
    """The offset of one needle's tip, learned while the needle is tracked."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the needle."""
        self._average_px = 0.0

    @property
    def off_axis_px(self) -> float:
        """How far the tip is off the axis, along the normal; 0 if it is not clearly off it."""
        return self._average_px if abs(self._average_px) >= MIN_PX else 0.0

    def learn(self, strip: RectifiedStrip, patch: RectifiedStrip, tip_px: float, fit: LineFit) -> None:
        """Learn from one image.

        Args:
            strip: The strip along the shaft.
            patch: The tip patch along the same line.
            tip_px: The tip along both.
            fit: The shaft's line.
        """
        end = round(tip_px - float(patch.u_px[0]))
        if not POINT <= end <= len(patch.u_px):
            return
        tip = slice(end - POINT, end)
        off_axis_px = _off_axis_px(patch, tip, fit)
        if abs(off_axis_px) >= MIN_PX and is_sharp(patch.excess[:, tip], SHARP_SHARE, patch.noise_grey):
            behind_px = _behind_px(strip, tip_px, fit)
            if behind_px is not None and math.copysign(1, off_axis_px) * (off_axis_px - behind_px) >= MIN_PX:
                self._average_px += RATE * (off_axis_px - self._average_px)
                return
        self._average_px -= DOUBT_RATE * self._average_px


def _behind_px(strip: RectifiedStrip, tip_px: float, fit: LineFit) -> float | None:
    """Return how far off the line the shaft's middle is before its point; None if that is not inside."""
    farthest, nearest = (tip_px - widths * fit.width_px for widths in BEHIND)
    start = max(int(strip.u_px.searchsorted(farthest)), strip.inside.start)
    stop = int(strip.u_px.searchsorted(nearest))
    return _off_axis_px(strip, slice(start, stop), fit) if stop - start >= MIN_BEHIND else None


def _off_axis_px(strip: RectifiedStrip, part: slice, fit: LineFit) -> float:
    """Return how far off the line the contrast's centroid is, across the shaft; 0 without contrast."""
    along_px = (float(strip.u_px[part.start]) + float(strip.u_px[part.stop - 1])) / 2
    axis, reach_px = strip.half_px + fit.offset_px + fit.slope * along_px, fit.width_px / 2 + MARGIN_PX
    lane = contrast_centroid(strip, round(axis - reach_px), round(axis + reach_px), part)
    return 0.0 if math.isnan(lane) else lane - axis
