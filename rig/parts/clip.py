"""The actuator clip: snaps onto a stylus and holds a coin motor. In its own frame: the stylus along z."""

from build123d import Part, Plane

from rig.shapes import block, prism, rod
from rig.standard import MOTOR_MM, PRESS_MM, STYLUS_MM, Print

__all__ = ["PRINT", "build", "motor", "stylus"]

PRINT = Print(up=(0, 0, 1), lies_on="one end of the ring", infill_percent=100, material="PETG", color="any")
LENGTH_MM, RING_MM, FLOOR_MM, RIM_MM = 14.0, 2.2, 1.6, 1.6
PLAY_MM = 0.1
"""Between ring and stylus; foil or tape makes up for other diameters."""
WIRE_MM = 2.5


def build() -> Part:
    """Return the clip."""
    inner = STYLUS_MM / 2 + PLAY_MM
    outer, half = inner + RING_MM, MOTOR_MM[0] / 2 + RIM_MM
    top = inner + FLOOR_MM + MOTOR_MM[1]
    ends = (0, 0, 0), (0, 0, LENGTH_MM)
    clip = rod(*ends, 2 * outer) + block((-half, half), (0, top), (0, LENGTH_MM))
    clip -= rod(*ends, 2 * inner)
    gap = [(0.0, 0.0), (-outer, -1.05 * outer), (outer, -1.05 * outer)]
    clip -= prism(gap, Plane.XY, 0, LENGTH_MM)
    middle = LENGTH_MM / 2
    clip -= rod((0, inner + FLOOR_MM, middle), (0, top + 1, middle), MOTOR_MM[0] + 2 * PRESS_MM)
    return clip - block((-WIRE_MM / 2, WIRE_MM / 2), (inner + FLOOR_MM, top + 1), (middle, LENGTH_MM + 1))


def motor() -> Part:
    """Return the motor in its pocket."""
    low = STYLUS_MM / 2 + PLAY_MM + FLOOR_MM + PRESS_MM
    return rod((0, low, LENGTH_MM / 2), (0, low + MOTOR_MM[1], LENGTH_MM / 2), MOTOR_MM[0])


def stylus() -> Part:
    """Return a piece of the stylus."""
    return rod((0, 0, -20), (0, 0, LENGTH_MM + 20), STYLUS_MM)
