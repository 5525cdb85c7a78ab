"""How far beside its shaft's axis a needle's tip lies: a bevel's does, by up to half the needle's width.

Turns a shaft and a close-up of its tip, image by image, into one offset. The last bit of a point is narrow,
so where its middle lies does not depend on how the metal is lit. That of a blunt end does, and so does that
of the shaft behind: where both are alike, there is no bevel. Knows no line but the one that was fitted.
"""

import ctypes
import math

from haptigraph.perception.native.library import function
from haptigraph.perception.needle.rectify import RectifiedStrip
from haptigraph.perception.needle.shaft_line import LineFit
from haptigraph.perception.needle.sharpness import is_sharp

__all__ = ["Bevel"]

POINT = 2  # stations before the tip, that tell
BEHIND = 5.0, 3.0  # widths behind the tip, from where to where the shaft is whole
LEAST_BEHIND = 3  # stations
SPARE_PX = 1.0  # of blur beside the shaft
SHARP_SHARE = 0.2  # of its contrast: a shadow beside the tip is less sharp
RATE, DOUBT_RATE = 0.2, 0.05  # of what one image tells, if it tells of a bevel, and if not
LEAST_PX = 1.0  # beside the axis, and beside the middle of what is behind

_middle_lane = function("middle_lane", "piiii", ctypes.c_double)


class Bevel:
    """Where the tip of one needle lies, learned while it is looked at."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the needle."""
        self._seen_px = 0.0

    @property
    def aside_px(self) -> float:
        """How far off the axis, along the normal; 0 if it is not clearly beside it."""
        return self._seen_px if abs(self._seen_px) >= LEAST_PX else 0.0

    def learn(self, strip: RectifiedStrip, closeup: RectifiedStrip, tip_px: float, fit: LineFit) -> None:
        """Take in one image.

        Args:
            strip: The straightened surroundings of the shaft.
            closeup: Of its tip, along the same line, a station per pixel.
            tip_px: Where that is along both.
            fit: The shaft's line.
        """
        end = round(tip_px - float(closeup.u_px[0]))
        if not POINT <= end <= len(closeup.u_px):
            return
        tip = slice(end - POINT, end)
        aside_px = _middle_px(closeup, tip, fit)
        if abs(aside_px) >= LEAST_PX and is_sharp(closeup.excess[:, tip], SHARP_SHARE, closeup.noise_grey):
            behind_px = _behind_px(strip, tip_px, fit)
            if behind_px is not None and math.copysign(1, aside_px) * (aside_px - behind_px) >= LEAST_PX:
                self._seen_px += RATE * (aside_px - self._seen_px)
                return
        self._seen_px -= DOUBT_RATE * self._seen_px


def _behind_px(strip: RectifiedStrip, tip_px: float, fit: LineFit) -> float | None:
    """Return how far from the line the shaft's middle lies before its point; None if that is not inside."""
    farthest, nearest = (tip_px - widths * fit.width_px for widths in BEHIND)
    start = max(int(strip.u_px.searchsorted(farthest)), strip.inside.start)
    stop = int(strip.u_px.searchsorted(nearest))
    return _middle_px(strip, slice(start, stop), fit) if stop - start >= LEAST_BEHIND else None


def _middle_px(strip: RectifiedStrip, part: slice, fit: LineFit) -> float:
    """Return how far from the line the middle of what differs lies, across the shaft; 0 if nothing does."""
    along_px = (float(strip.u_px[part.start]) + float(strip.u_px[part.stop - 1])) / 2
    axis, reach_px = strip.half_px + fit.offset_px + fit.slope * along_px, fit.width_px / 2 + SPARE_PX
    lane = _middle_lane(strip.native, round(axis - reach_px), round(axis + reach_px), part.start, part.stop)
    return 0.0 if math.isnan(lane) else lane - axis
