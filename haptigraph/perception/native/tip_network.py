"""The tip network as C has it (`tip_network.c`): pixels along a shaft -> where its tip is, and how surely."""

import ctypes

import numpy as np

from haptigraph.imaging import FloatImage, Floats
from haptigraph.perception.native.arrays import FLOAT, address, checked
from haptigraph.perception.native.library import LIBRARY
from haptigraph.perception.native.strip import RectifiedStrip, native_of

__all__ = [
    "KINDS",
    "PLACES",
    "STATIONS",
    "VALUES",
    "WEIGHTS",
    "judge_tip",
    "tip_places",
    "tip_posterior",
    "tip_window",
]

STATIONS = LIBRARY.constant("TIP_STATIONS")
"""Of a window along the shaft."""
PLACES = LIBRARY.constant("TIP_PLACES")
"""Where a tip may be."""
KINDS = LIBRARY.constant("TIP_KINDS")
"""The places, none of them, and two precisions of the contrast step."""
VALUES = LIBRARY.constant("TIP_VALUES")
"""Of a window."""
WEIGHTS = LIBRARY.constant("TIP_WEIGHTS")
"""Numbers that the network learns."""
DOUBLE = np.dtype(np.float64)

_tip_window = LIBRARY.function("tip_window", "pddddip")
_tip_places = LIBRARY.function("tip_places", "pppp")
_tip_posterior = LIBRARY.function("tip_posterior", "pdp")
_judge_tip = LIBRARY.function("judge_tip", "ppdddddip")
_Context, _Tip = ctypes.c_double * 3, ctypes.c_double * 3


def tip_window(
    strip: RectifiedStrip,
    offset_px: float,
    slope: float,
    tip_px: float,
    px_per_mm: float,
    *,
    is_outside: bool = False,
) -> FloatImage:
    """Return what a strip shows about an apparent tip, (VALUES,).

    Three channels (excess, detrended, colour) of rows of stations for each lane, and last which stations are
    on the tip's side of the wall.

    Args:
        strip: The strip.
        offset_px: Of the shaft's middle from the strip's, where u is 0.
        slope: Of the shaft's middle along the strip.
        tip_px: The apparent tip.
        px_per_mm: Scale.
        is_outside: Whether the tip is before the globe, not in it.
    """
    if not 0 < px_per_mm < np.inf:
        raise ValueError(f"px_per_mm: expected a positive number, found {px_per_mm}")
    values = np.empty(VALUES, np.float32)
    given = float(offset_px), float(slope), float(tip_px), float(px_per_mm)
    _tip_window(native_of(strip).packed, *given, bool(is_outside), address(values))
    return values


def tip_places(weights: FloatImage, window: FloatImage, context: tuple[float, float, float]) -> Floats:
    """Return the probability of a tip at each place, at none of them, and at the contrast step, (KINDS,).

    Args:
        weights: What the network has learned, (WEIGHTS,).
        window: What `tip_window` returned; is changed.
        context: Noise [grey levels], scale [px per mm], and the step's standard deviation [px].
    """
    places = np.empty(KINDS, np.float64)
    given = checked("weights", weights, FLOAT, (WEIGHTS,)), checked("window", window, FLOAT, (VALUES,))
    _tip_places(*given, _Context(*context), address(places))
    return places


def tip_posterior(places: Floats, px_per_mm: float) -> tuple[float, float, float]:
    """Return how far a tip is beyond an apparent one, its sd [mm], and how probably it is far from there.

    Args:
        places: What `tip_places` returned about that step.
        px_per_mm: Scale.
    """
    if not 0 < px_per_mm < np.inf:
        raise ValueError(f"px_per_mm: expected a positive number, found {px_per_mm}")
    found = _Tip()
    _tip_posterior(checked("places", places, DOUBLE, (KINDS,)), float(px_per_mm), found)
    return found[0], found[1], found[2]


def judge_tip(
    strip: RectifiedStrip,
    weights: FloatImage,
    line: tuple[float, float],
    tip: tuple[float, float],
    px_per_mm: float,
    *,
    is_outside: bool = False,
) -> tuple[float, float, float]:
    """Return what `tip_posterior` does, about a tip along a strip.

    Args:
        strip: The strip.
        weights: What the network has learned, (WEIGHTS,).
        line: Offset and slope of the shaft's middle, as `tip_window` has them.
        tip: Where the apparent tip is along the strip, and its standard deviation [px].
        px_per_mm: Scale.
        is_outside: Whether the tip is before the globe, not in it.
    """
    if not 0 < px_per_mm < np.inf:
        raise ValueError(f"px_per_mm: expected a positive number, found {px_per_mm}")
    found, given = _Tip(), (*map(float, (*line, *tip, px_per_mm)), bool(is_outside))
    _judge_tip(native_of(strip).packed, checked("weights", weights, FLOAT, (WEIGHTS,)), *given, found)
    return found[0], found[1], found[2]
