"""The haptic grammar: patterns of vibration and force fields, as a procedure defines them.

Parameters only; where in the eye a force field acts follows from each image.
"""

from typing import Literal

from msgspec import Struct

__all__ = ["OFF", "Follow", "ForceField", "Pattern"]


class Follow(Struct, frozen=True, forbid_unknown_fields=True):
    """How one parameter of a pattern follows a measure of the scene."""

    key: Literal["amplitude", "frequency_hz", "rate_hz"]
    """The parameter; `rate_hz` is the pulse rate, set by the pauses."""
    measure: str
    """Name of the measure in the graph."""
    start: tuple[float, float]
    """(measure, parameter): before this measure, the parameter stays at this value."""
    end: tuple[float, float]
    """(measure, parameter): from this measure on, the parameter stays at this value."""
    curve: float = 1.0
    """Exponent of the interpolation in between; 1 is linear, 2 slow at first."""
    dead_band: float = 0.0
    """Changes of the measure up to this size, its noise, are ignored."""
    because: str = ""
    """Why the parameter falls where the state becomes worse; empty if it grows."""


class Pattern(Struct, frozen=True, forbid_unknown_fields=True):
    """One pattern of the haptic grammar."""

    name: str
    kind: Literal["off", "continuous", "pulses", "bursts"]
    """Pulses repeat until the pattern changes; bursts play `count` times, once on entry."""
    amplitude: float = 0.0
    """Strength in [0, 1]."""
    frequency_hz: float = 0.0
    """Vibration frequency, for devices that can choose it."""
    on_ms: float = 0.0
    off_ms: float = 0.0
    count: int = 0
    rearm_ms: float = 0.0
    """Bursts play again only after their state was left for this time."""
    follow: tuple[Follow, ...] = ()
    """Parameters that follow a measure; empty in a command, which contains their current values."""


OFF = Pattern("off", "off")
"""Silence."""


class ForceField(Struct, frozen=True, forbid_unknown_fields=True):
    """One force of the haptic grammar. Stiffness and damping are those at the hand.

    A cone pulls the tip back to within an angle of the line trocar -> target; a plane keeps it above the
    retina; viscous resists every motion.
    """

    name: str
    kind: Literal["cone", "plane", "viscous"]
    stiffness_n_per_mm: float = 0.0
    """Force per depth of penetration, per mm of hand motion."""
    damping_n_s_per_mm: float = 0.0
    """Resistance to motion; that of a cone or a plane acts only beyond its surface, along the normal."""
    limit_n: float = 1.0
    """The force never exceeds this."""
    half_angle_deg: float = 0.0
    """Of a cone."""
    height_mm: float = 0.0
    """Of a plane: the tip's lowest permitted height above the retina below it."""
