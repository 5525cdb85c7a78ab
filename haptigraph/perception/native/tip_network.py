"""The tip network as C has it (`tip_network.c`): pixels along a shaft -> where its tip is, and how surely."""

import ctypes

import numpy as np

from haptigraph.imaging import FloatImage
from haptigraph.perception.native.arrays import FLOAT, address, checked, checked_scale
from haptigraph.perception.native.library import LIBRARY
from haptigraph.perception.native.strip import RectifiedStrip, native_of

__all__ = ["KINDS", "PLACES", "STATIONS", "VALUES", "WEIGHTS", "judge_tip", "tip_window"]

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

_tip_window = LIBRARY.function("tip_window", "pddddip")
_judge_tip = LIBRARY.function("judge_tip", "ppdddddip")
_Tip = ctypes.c_double * 3


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
    values = np.empty(VALUES, np.float32)
    given = float(offset_px), float(slope), float(tip_px), checked_scale(px_per_mm)
    _tip_window(native_of(strip).packed, *given, bool(is_outside), address(values))
    return values


def judge_tip(
    strip: RectifiedStrip,
    weights: FloatImage,
    line: tuple[float, float],
    tip: tuple[float, float],
    px_per_mm: float,
    *,
    is_outside: bool = False,
) -> tuple[float, float, float]:
    """Return how far a tip is beyond an apparent one, its sd [mm], and how probably it is far from there.

    Args:
        strip: The strip.
        weights: What the network has learned, (WEIGHTS,).
        line: Offset and slope of the shaft's middle, as `tip_window` has them.
        tip: Where the apparent tip is along the strip, and its standard deviation [px].
        px_per_mm: Scale.
        is_outside: Whether the tip is before the globe, not in it.
    """
    found, given = _Tip(), (*map(float, (*line, *tip)), checked_scale(px_per_mm), bool(is_outside))
    _judge_tip(native_of(strip).packed, checked("weights", weights, FLOAT, (WEIGHTS,)), *given, found)
    return found[0], found[1], found[2]
