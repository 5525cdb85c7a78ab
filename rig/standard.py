"""Dimensions that all rigs share: fits, screws, bought parts, and how parts are printed [mm]."""

from msgspec import Struct

__all__ = [
    "BED_MM",
    "CLEARANCE_MM",
    "HEAD_MM",
    "INSERT_DEPTH_MM",
    "INSERT_MM",
    "LED_MM",
    "MOTOR_MM",
    "PRESS_MM",
    "SHANK_MM",
    "SLIDE_MM",
    "STYLUS_MM",
    "Print",
]

SLIDE_MM = 0.2
"""Play on every side of a part that slides into another."""
PRESS_MM = 0.05
"""Play on every side of a part that is pressed into another."""
SHANK_MM = 3.0
"""M3 screw."""
CLEARANCE_MM = 3.4
"""Hole for an M3 screw, ISO 273, medium."""
HEAD_MM = (5.5, 3.0)
"""Diameter and height of its cylinder head, ISO 4762."""
INSERT_MM = 4.0
"""Hole for a heat-set M3 insert, 4.6 mm outside."""
INSERT_DEPTH_MM = 6.5
LED_MM = 5.1
"""Hole for a 5 mm LED."""
MOTOR_MM = (10.0, 3.4)
"""Diameter and thickness of a coin motor."""
STYLUS_MM = 10.0
"""Diameter of the stylus where the actuator is clipped on."""
BED_MM = (210.0, 210.0, 200.0)
"""What a common printer can print."""


class Print(Struct, frozen=True):
    """How a part is printed."""

    up: tuple[float, float, float]
    """What is up on the printer, in the eye frame."""
    lies_on: str
    """The face on the bed, in words."""
    supports: str = ""
    """Where supports are needed; empty: nowhere."""
    material: str = "PLA"
    color: str = "black, matt"
    layer_mm: float = 0.2
    infill_percent: float = 20
    min_wall_mm: float = 1.2
    note: str = ""
