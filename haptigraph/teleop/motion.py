"""Messages of teleoperation: the motion of the operator's hand, and the settings that scale and filter it.

Both are external input (a page, a study), so every field is bounded and unknown fields are refused.
"""

import math
from typing import Annotated

from msgspec import Meta, Struct

__all__ = ["HandMotion", "MotionScale", "TeleopSettings", "TremorMm"]

Displacement = Annotated[float, Meta(ge=-1000, le=1000)]
MotionScale = Annotated[float, Meta(ge=0, le=10)]
TremorMm = Annotated[float, Meta(ge=0, le=10)]


class HandMotion(Struct, frozen=True, forbid_unknown_fields=True):
    """The displacement of the hand since its previous message."""

    engaged: bool
    """Whether the clutch is engaged; otherwise the needle does not move."""
    along_mm: Displacement = 0.0
    """Along the shaft, positive into the eye."""
    across_mm: Displacement = 0.0
    """Across the shaft, in the section: positive moves the tip to the surgeon's right (+x of the eye frame,
    for a needle from above; exactly: along the direction of the shaft rotated by +90 degrees)."""
    apart_mm: Displacement = 0.0
    """Between thumb and finger: positive opens the jaws of forceps; no effect on a tool without jaws."""
    outwards_mm: Displacement = 0.0
    """Across the shaft and the section: positive moves the tip towards the camera (+z of the eye frame;
    exactly if the shaft lies in the section). No effect on a robot that moves in the section."""

    def __post_init__(self) -> None:
        _must_be_finite(self)


class TeleopSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """The mapping from hand motion to tool motion."""

    motion_scale: MotionScale = 0.2
    """Tool motion over hand motion."""
    tremor_filter: bool = False
    """Whether motion of 8 to 12 Hz is removed."""
    added_tremor_mm: TremorMm = 0.0
    """Simulated tremor of the hand, 8 to 12 Hz, RMS per axis, while the clutch is engaged. It demonstrates
    the filter to an operator at a keyboard, whose input has no tremor."""

    def __post_init__(self) -> None:
        _must_be_finite(self)


def _must_be_finite(message: Struct) -> None:
    """Refuse nan and infinity, which pass the bounds or come from Python, where bounds are unchecked."""
    for name in message.__struct_fields__:
        value = getattr(message, name)
        if not math.isfinite(value):
            raise ValueError(f"{name} must be a finite number, found {value}")
