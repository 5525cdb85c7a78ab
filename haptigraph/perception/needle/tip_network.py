"""How certain a tip is: a selected tip -> its most probable place, its standard deviation, if it is known.

A small convolutional network reads the pixels along the shaft (`native/tip_network.c`). It learned from
rendered and simulated needles, degraded in many ways, where their tips are (`make train-tip`). It knows how
precise the selected contrast step is, and gives the probability of that step and of other places. Where the
tip may be far from their mean, it is not known. Images of one needle are judged together.
"""

import math
from importlib import resources

import numpy as np
from msgspec.structs import replace

from haptigraph.perception.native.tip_network import judge_tip
from haptigraph.perception.needle.coarse_tip import TipEstimate
from haptigraph.perception.needle.rectify import RectifiedStrip
from haptigraph.perception.needle.shaft_line import LineFit

__all__ = ["FAR_SD_MM", "TipJudge"]

FILE = "tip_network.npy"
MAX_FAR, MAX_FAR_NOW = 0.03, 0.1  # probability that a known tip is far: mean of late, and in its own image
MIN_FAR, FAR_RATE = 1e-4, 0.2  # less is no more certain; weight of an image in the mean

FAR_SD_MM = 1.6
"""Of a tip that is not where its contrast ends: its point goes on, too thin or too faint."""


class TipJudge:
    """Judge the tips of one needle after another.

    What hides a point in some images, such as a face as bright as its ground, hides it in those between as
    well, though the network may be certain there. So the mean over images decides, of the logarithm.
    """

    def __init__(self) -> None:
        with resources.as_file(resources.files("haptigraph.models") / FILE) as file:
            self._weights = np.ascontiguousarray(np.load(file), np.float32)
        self.forget()

    def forget(self) -> None:
        """Forget the needle."""
        self._log_far: float | None = None

    def judged(self, strip: RectifiedStrip, fit: LineFit, tip: TipEstimate, px_per_mm: float) -> TipEstimate:
        """Return a tip at its most probable place, with its standard deviation.

        Inside the globe, also whether it is known. Outside, that it is there is certain, so its standard
        deviation is that of all places where it may be.

        Args:
            strip: The strip along the shaft.
            fit: The shaft's line.
            tip: The selected tip; the wall does not occlude it.
            px_per_mm: Scale.
        """
        is_outside = tip.where == "outside"
        beyond_mm, sd_mm, far = judge_tip(
            *(strip, self._weights, (fit.offset_px, fit.slope), (tip.u_px, tip.sd_px), px_per_mm),
            is_outside=is_outside,
        )
        u_px = tip.u_px + beyond_mm * px_per_mm
        if not is_outside:
            return replace(tip, u_px=u_px, shift_sd_px=sd_mm * px_per_mm, is_known=self._is_known(far))
        whole_sd_mm = math.hypot(sd_mm, FAR_SD_MM * math.sqrt(far))
        return replace(tip, u_px=min(u_px, strip.wall_px), shift_sd_px=whole_sd_mm * px_per_mm)

    def _is_known(self, far: float) -> bool:
        """Return whether a tip is known, with how probably it is far from there by its own image."""
        log_far = math.log(max(far, MIN_FAR))
        before = log_far if self._log_far is None else self._log_far
        self._log_far = before + FAR_RATE * (log_far - before)
        return self._log_far <= math.log(MAX_FAR) and far <= MAX_FAR_NOW
