"""The shaft's own profile: whether a needle goes on beyond an apparent tip, or ends before it.

Turns a rectified strip, a fitted line and an apparent tip into how much of the shaft's profile, in grey and
colour across it, the stations beyond the tip show (`native/profile.c`). A point that fades keeps that
profile, however soft and faint it is. A soft shadow does not have it; a hard one begins with a drop.
"""

import math

from haptigraph.perception.native.strip import profile_share
from haptigraph.perception.needle.rectify import STATION_PX, RectifiedStrip
from haptigraph.perception.needle.shaft_line import LineFit

__all__ = ["ShaftProfile"]

# From the tip: where the profile is measured; the second if too little of the first is inside the globe.
SHAFTS_MM = (-4.5, -1.2), (-2.0, -0.3)
MIN_SHAFT = 4  # stations
REACH_PX = 4  # lanes beyond the shaft's edges
BEYOND, BEFORE = (1, 6), (-6, -1)  # stations close to the tip that are compared
MIN_SHARE, MIN_SNR = 0.1, 3.0  # of the profile; less is none
MIN_LEFT, MIN_LEFT_SOFT = 0.5, 0.25  # of what is before a tip: less beyond it is a drop, or a soft shadow
MAX_POINT_MM, MAX_EVEN = 2.0, 0.5  # length of a soft point, and share of its profile at its end
SEEN_MM, BLURRED = 0.5, 3  # of a shaft that is seen beyond a tip; stations that the tip's blur may fill


class ShaftProfile:
    """What is left of a shaft's profile beyond an apparent tip.

    Args:
        strip: The strip.
        fit: The shaft's line.
        px_per_mm: Scale.
    """

    def __init__(self, strip: RectifiedStrip, fit: LineFit, px_per_mm: float) -> None:
        self._strip, self._fit, self._px_per_mm = strip, fit, px_per_mm

    def continues(self, tip_px: float, *, softly: bool = False) -> bool:
        """Return whether the profile continues beyond an apparent tip without a drop.

        Args:
            tip_px: The apparent tip, inside the globe.
            softly: Whether a quarter of what is before the tip suffices, which few shadows have.
        """
        share, sd, *_ = self._share(tip_px, self._close(tip_px, *BEYOND))
        before = self._share(tip_px, self._close(tip_px, *BEFORE))[0]
        return share > max(MIN_SHARE, MIN_SNR * sd, (MIN_LEFT_SOFT if softly else MIN_LEFT) * before)

    def is_seen(self, tip_px: float, until_px: float) -> bool:
        """Return whether the profile is seen anywhere beyond an apparent tip and its blur.

        A bubble behind a bright shaft, as bright as it, hides a part of it. A dark rest may be a shadow.

        Args:
            tip_px: The apparent tip, inside the globe.
            until_px: How far along the strip there is contrast.
        """
        beyond, seen = self._between(tip_px, until_px), round(SEEN_MM * self._px_per_mm / STATION_PX)
        starts = range(beyond.start + BLURRED, beyond.stop - seen + 1)
        shares = (self._share(tip_px, slice(start, start + seen)) for start in starts)
        return any(share > max(MIN_LEFT_SOFT, MIN_SNR * sd) for share, sd, *_ in shares)

    def rims_continue(self, tip_px: float, until_px: float) -> bool:
        """Return whether a highlight ends at an apparent tip, and the dark rims about it go on.

        Args:
            tip_px: The apparent tip, inside the globe.
            until_px: How far along the strip there is contrast.
        """
        beyond = self._between(tip_px, until_px)
        if beyond.stop - beyond.start <= BLURRED:
            return False
        return self._share(tip_px, beyond, SHAFTS_MM[1:])[2] > MIN_LEFT_SOFT

    def fades(self, tip_px: float, until_px: float) -> bool:
        """Return whether what is beyond an apparent tip has the profile, and fades: most shadows are even.

        Args:
            tip_px: The apparent tip, inside the globe.
            until_px: How far along the strip there is contrast.
        """
        if until_px - tip_px > MAX_POINT_MM * self._px_per_mm or not self.continues(tip_px, softly=True):
            return False
        third_px = (until_px - tip_px) / 3
        starts_px = tip_px, until_px - third_px
        first, last = (self._share(tip_px, self._between(px, px + third_px))[0] for px in starts_px)
        return last < MAX_EVEN * first

    def _between(self, from_px: float, until_px: float) -> slice:
        return slice(*(int(self._strip.u_px.searchsorted(px, "right")) for px in (from_px, until_px)))

    def _close(self, tip_px: float, start: int, stop: int) -> slice:
        tip = int(self._strip.u_px.searchsorted(tip_px))
        return slice(max(tip + start, 0), max(tip + stop, 0))

    def _share(
        self, tip_px: float, part: slice, shafts_mm: tuple[tuple[float, float], ...] = SHAFTS_MM
    ) -> tuple[float, float, float]:
        """Return what `profile_share` says about some stations, and the profile before a tip."""
        strip, fit = self._strip, self._fit
        tip = int(strip.u_px.searchsorted(tip_px))
        reach_px = math.ceil(fit.width_px / 2) + REACH_PX
        for from_mm, until_mm in shafts_mm:
            start = max(tip + round(from_mm * self._px_per_mm / STATION_PX), strip.inside.start)
            stop = tip + round(until_mm * self._px_per_mm / STATION_PX)
            if stop - start >= MIN_SHAFT:
                return profile_share(strip, fit.offset_px, fit.slope, reach_px, slice(start, stop), part)
        return 0.0, 0.0, 0.0
