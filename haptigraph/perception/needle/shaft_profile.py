"""The shaft's own profile: whether a needle goes on beyond an apparent tip, or ends before it.

Turns a rectified strip, a fitted line and an apparent tip into how much of the shaft's profile, in grey and
colour across it, the stations beyond the tip show (`native/profile.c`). A point that fades keeps that
profile, however soft and faint it is. A soft shadow does not have it; a hard one begins with a drop. What
gets brighter beside the shaft towards its end is no point, but a bubble in line with it.
"""

import math

from haptigraph.perception.native.strip import profile_share, widening
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
MAX_FAINT_MM = 0.4  # a longer rest is a shadow
SEEN_MM, BLURRED = 0.5, 3  # of a shaft that is seen beyond a tip; stations that the tip's blur may fill
BESIDE_MM = 0.15, 0.57  # from the shaft's middle, where a bubble is bright
END_MM, BEFORE_END_MM = 0.8, 2.0  # the apparent end of a shaft, and what it is compared to
MAX_WIDENING = 0.3  # of the shaft's contrast
BLUNT = (-6, -3), (-3, -1)  # stations before the tip, where an end may be as wide as its shaft:
MIN_BLUNT, MAX_BLUNT = 0.8, 1.2  # so many times; a bevel that is seen from the front is wider
RESOLVED, FOCUSED_MM = 3.5, 0.038  # least width of its shaft, in sds of the blur; the blur of a sharp picture


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

    def widens(self, tip_px: float) -> bool:
        """Return whether it gets brighter beside the shaft towards an apparent tip: a bubble is there.

        Args:
            tip_px: The apparent tip, inside the globe.
        """
        strip, fit, scale = self._strip, self._fit, self._px_per_mm
        stop = int(strip.u_px.searchsorted(tip_px, "right"))
        end, before = (round(length_mm * scale / STATION_PX) for length_mm in (END_MM, BEFORE_END_MM))
        part = slice(max(stop - end - before, strip.inside.start), stop)
        beside_px = math.ceil(BESIDE_MM[0] * scale), math.ceil(BESIDE_MM[1] * scale)
        return widening(strip, fit.offset_px, fit.slope, beside_px, part, end) > MAX_WIDENING

    def blunt_px(self, tip_px: float, blur_px: float) -> float:
        """Return the width of a bright end that is as wide as its shaft; 0 of any other.

        Args:
            tip_px: The apparent tip, inside the globe.
            blur_px: Standard deviation of the blur: a thin shaft is as wide as that makes it, to its end.
        """
        least_px = RESOLVED * max(blur_px, FOCUSED_MM * self._px_per_mm)
        widths_px = (self._share(tip_px, self._close(tip_px, *part))[3:] for part in BLUNT)
        for shaft_px, end_px in widths_px:
            if shaft_px < least_px or not MIN_BLUNT * shaft_px <= end_px <= MAX_BLUNT * shaft_px:
                return 0.0
        return end_px

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

    def faint_rest_px(self, tip_px: float, until_px: float) -> float:
        """Return how far a point may reach beyond an apparent tip, by the profile of its faint rest.

        Args:
            tip_px: The apparent tip, inside the globe.
            until_px: How far along the strip there is contrast.
        """
        rest_px = until_px - tip_px
        if not 0 < rest_px <= MAX_FAINT_MM * self._px_per_mm:
            return 0.0
        share, sd, *_ = self._share(tip_px, self._between(tip_px, until_px))
        before = self._share(tip_px, self._close(tip_px, *BEFORE))[0]
        is_clear = min(share, before) > MIN_SNR * sd > 0
        return rest_px * min(share / (MIN_LEFT * before), 1.0) if is_clear else 0.0

    def _between(self, from_px: float, until_px: float) -> slice:
        return slice(*(int(self._strip.u_px.searchsorted(px, "right")) for px in (from_px, until_px)))

    def _close(self, tip_px: float, start: int, stop: int) -> slice:
        tip = int(self._strip.u_px.searchsorted(tip_px))
        return slice(max(tip + start, 0), max(tip + stop, 0))

    def _share(
        self, tip_px: float, part: slice, shafts_mm: tuple[tuple[float, float], ...] = SHAFTS_MM
    ) -> tuple[float, float, float, float, float]:
        """Return what `profile_share` says about some stations, and the profile before a tip."""
        strip, fit = self._strip, self._fit
        tip = int(strip.u_px.searchsorted(tip_px))
        reach_px = math.ceil(fit.width_px / 2) + REACH_PX
        for from_mm, until_mm in shafts_mm:
            start = max(tip + round(from_mm * self._px_per_mm / STATION_PX), strip.inside.start)
            stop = tip + round(until_mm * self._px_per_mm / STATION_PX)
            if stop - start >= MIN_SHAFT:
                return profile_share(strip, fit.offset_px, fit.slope, reach_px, slice(start, stop), part)
        return 0.0, 0.0, 0.0, 0.0, 0.0
