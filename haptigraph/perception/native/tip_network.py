"""The tip network as C has it (`tip_network.c`): pixels along a shaft -> where its tip is, and how surely."""

import ctypes

import numpy as np

from haptigraph.imaging import FloatImage, Floats
from haptigraph.perception.native.arrays import FLOAT, address, checked
from haptigraph.perception.native.library import LIBRARY
from haptigraph.perception.native.strip import RectifiedStrip, native_of

__all__ = ["PLACES", "STATIONS", "VALUES", "WEIGHTS", "tip_places", "tip_posterior", "tip_window"]

STATIONS = LIBRARY.constant("TIP_STATIONS")
"""Of a window along the shaft."""
PLACES = LIBRARY.constant("TIP_PLACES")
"""Where a tip may be."""
VALUES = LIBRARY.constant("TIP_VALUES")
"""Of a window."""
WEIGHTS = LIBRARY.constant("TIP_WEIGHTS")
"""Numbers that the network learns."""
DOUBLE = np.dtype(np.float64)

_tip_window = LIBRARY.function("tip_window", "pddddp")
_tip_places = LIBRARY.function("tip_places", "ppdp")
_tip_posterior = LIBRARY.function("tip_posterior", "pddp")
_Pair = ctypes.c_double * 2


def tip_window(
    strip: RectifiedStrip, offset_px: float, slope: float, tip_px: float, px_per_mm: float
) -> FloatImage:
    """Return what a strip shows about an apparent tip, (VALUES,).

    Three channels (excess, detrended, colour) of rows of stations for each lane, and last which stations are
    inside the globe.

    Args:
        strip: The strip.
        offset_px: Of the shaft's middle from the strip's, where u is 0.
        slope: Of the shaft's middle along the strip.
        tip_px: The apparent tip.
        px_per_mm: Scale.
    """
    if not 0 < px_per_mm < np.inf:
        raise ValueError(f"px_per_mm: expected a positive number, found {px_per_mm}")
    values = np.empty(VALUES, np.float32)
    given = float(offset_px), float(slope), float(tip_px), float(px_per_mm)
    _tip_window(native_of(strip).packed, *given, address(values))
    return values


def tip_places(weights: FloatImage, window: FloatImage, noise_grey: float) -> Floats:
    """Return the probability of a tip at each place, and, last, of a tip at none of them, (PLACES + 1,).

    Args:
        weights: What the network has learned, (WEIGHTS,).
        window: What `tip_window` returned; is changed.
        noise_grey: Standard deviation of a pixel.
    """
    places = np.empty(PLACES + 1, np.float64)
    given = checked("weights", weights, FLOAT, (WEIGHTS,)), checked("window", window, FLOAT, (VALUES,))
    _tip_places(*given, float(noise_grey), address(places))
    return places


def tip_posterior(places: Floats, sd_mm: float, share: float) -> tuple[float, float]:
    """Return how far a tip is beyond a contrast step, and its standard deviation [mm].

    Args:
        places: What `tip_places` returned about that step.
        sd_mm: Standard deviation of the step.
        share: Share of such steps that are no tip.
    """
    if not 0 < sd_mm < np.inf:
        raise ValueError(f"sd_mm: expected a positive number, found {sd_mm}")
    found = _Pair()
    _tip_posterior(checked("places", places, DOUBLE, (PLACES + 1,)), float(sd_mm), float(share), found)
    return found[0], found[1]
