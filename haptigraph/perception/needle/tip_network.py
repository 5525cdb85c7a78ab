"""How certain a tip is: a selected tip -> its most probable place, its standard deviation, if it is known.

A small convolutional network reads the pixels along the shaft (`native/tip_network.c`). It learned from
rendered and simulated needles, degraded in many ways, where their tips are (`make train-tip`). It knows how
precise the selected contrast step is, and gives the probability of that step and of other places. Where the
tip may be far from their mean, it is not known.
"""

from importlib import resources

import numpy as np
from msgspec.structs import replace

from haptigraph.imaging import FloatImage
from haptigraph.perception.native.tip_network import tip_places, tip_posterior, tip_window
from haptigraph.perception.needle.coarse_tip import TipEstimate
from haptigraph.perception.needle.rectify import RectifiedStrip
from haptigraph.perception.needle.shaft_line import LineFit

__all__ = ["outside_globe", "shipped_weights", "with_certainty"]

FILE = "tip_network.npy"
MAX_FAR = 0.03  # probability that a known tip is far from where it is reported
OUTSIDE_MM = 0.03  # sd of a contrast step outside the globe
UNLOCATED_MM = 1.6  # where contrast is lost without a step: the point goes on, too thin or too faint


def with_certainty(
    strip: RectifiedStrip, fit: LineFit, tip: TipEstimate, px_per_mm: float, weights: FloatImage
) -> TipEstimate:
    """Return a tip inside the globe at its most probable place, with its standard deviation.

    Args:
        strip: The strip along the shaft.
        fit: The shaft's line.
        tip: The selected tip.
        px_per_mm: Scale.
        weights: What the network has learned, (n,).
    """
    window = tip_window(strip, fit.offset_px, fit.slope, tip.u_px, px_per_mm)
    places = tip_places(weights, window, (strip.noise_grey, px_per_mm, tip.sd_px))
    beyond_mm, sd_mm, far = tip_posterior(places, px_per_mm)
    u_px = tip.u_px + beyond_mm * px_per_mm
    return replace(tip, u_px=u_px, shift_sd_px=sd_mm * px_per_mm, is_known=far <= MAX_FAR)


def outside_globe(tip: TipEstimate, px_per_mm: float) -> TipEstimate:
    """Return a tip outside the globe with its standard deviation.

    There the background is often unknown, and a sharpened point fades on it. That it is outside is certain.

    Args:
        tip: The selected tip.
        px_per_mm: Scale.
    """
    return replace(tip, shift_sd_px=px_per_mm * (OUTSIDE_MM if tip.contrast_grey else UNLOCATED_MM))


def shipped_weights() -> FloatImage:
    """Return what the network has learned, (n,)."""
    with resources.as_file(resources.files("haptigraph.models") / FILE) as file:
        return np.ascontiguousarray(np.load(file), np.float32)
