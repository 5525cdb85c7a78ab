"""What a hand tells the robot, and how the robot takes it. Knows neither devices nor eyes.

Both come from outside (a page, a study), so every field is bounded and nothing else is let in.
"""

import math
from typing import Annotated

from msgspec import Meta, Struct

__all__ = ["HandMotion", "MotionScale", "TeleopSettings", "TremorMm"]

Displacement = Annotated[float, Meta(ge=-1000, le=1000)]
MotionScale = Annotated[float, Meta(ge=0, le=10)]
TremorMm = Annotated[float, Meta(ge=0, le=10)]


class HandMotion(Struct, frozen=True, forbid_unknown_fields=True):
    """How far the hand has moved since its last message. No message: no motion."""

    engaged: bool
    """Whether the clutch holds: without it the hand moves and the needle does not."""
    along_mm: Displacement = 0.0
    """Along the shaft, into the eye positive."""
    across_mm: Displacement = 0.0
    """Across the shaft, in the section: positive moves the tip to the surgeon's right (+x of the eye frame,
    for a needle from above; exactly: along the shaft's direction turned by +90 degrees)."""
    apart_mm: Displacement = 0.0
    """Thumb from finger: positive opens the jaws of forceps. Of a tool without jaws it moves nothing."""

    def __post_init__(self) -> None:
        _must_be_finite(self)


class TeleopSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """How the motion of the hand becomes motion of the tool."""

    motion_scale: MotionScale = 0.2
    """Tool motion over hand motion."""
    tremor_filter: bool = False
    """Whether motion of 8 to 12 Hz is taken out."""
    added_tremor_mm: TremorMm = 0.0
    """Simulated tremor of the hand, 8 to 12 Hz, RMS per axis, while it is engaged: for hands on a keyboard,
    which do not tremble, to feel what the filter does."""

    def __post_init__(self) -> None:
        _must_be_finite(self)


def _must_be_finite(message: Struct) -> None:
    """Refuse nan and infinity, which pass the bounds or come from Python, where bounds are not checked."""
    for name in message.__struct_fields__:
        value = getattr(message, name)
        if not math.isfinite(value):
            raise ValueError(f"{name} must be a finite number, found {value}")
