"""Viscoelastic deformation of tissue under a tip: one model for both phantoms.

Turns the tip's position over time into the depth of the dent along a surface. Each point is a standard
linear solid (Zener 1948, Elasticity and Anelasticity of Metals): a spring in parallel with a spring and a
dashpot in series, so that a released surface recovers in part at once and creeps back for the rest. Laterally
the surface is a stretched membrane on a bed of springs (Winkler 1867): the dent decays exponentially from the
tip. The retina is viscoelastic: Ferrara et al. 2021, Eye 35(7). The puncture depth and the time constant
differ between eyes and are set by the scenario; neither has been measured in a living eye. Forces are not
modelled.
"""

import math
from typing import Annotated, TypeAlias

import numpy as np
from msgspec import Meta, Struct

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats

__all__ = ["Dent", "Share", "TissueShape"]

Share: TypeAlias = Annotated[float, Meta(ge=0, le=1)]


class TissueShape(Struct, frozen=True, forbid_unknown_fields=True):
    """How tissue deforms: a scenario's [tissue] table; in a B-scan scenario, part of [retina]."""

    dent_mm: Annotated[float, Meta(ge=0.05, le=3)] = 0.45
    """Lateral distance at which a dent is 1/e as deep as at the tip."""
    puncture_mm: Annotated[float, Meta(ge=0, le=1)] = 0.08
    """Depth of the dent at which the tip punctures the surface."""
    drag_share: Share = 0.3
    """After puncture, depth of the dent as a share of the tip's depth below the resting surface."""
    prompt_share: Share = 0.6
    """Share of a dent that recovers at once on release."""
    relax_s: Annotated[float, Meta(ge=0.01, le=60)] = 0.6
    """Time constant of the dashpot."""


class Dent:
    """The dent of one surface under a tip.

    Args:
        shape: How the tissue deforms.
        along_mm: Points along the resting surface, ascending, (n,); for `press`, points of any arrangement.
    """

    def __init__(self, shape: TissueShape, along_mm: Floats) -> None:
        self._shape, self._along_mm = shape, along_mm
        self.restart()

    def restart(self) -> None:
        """Return to the resting surface."""
        self._crept_mm = np.zeros_like(self._along_mm)
        self.is_pierced = False
        """Whether the tip has punctured the surface."""

    def advance(self, elapsed_s: float, tip_mm: Vec | None) -> Floats:
        """Advance in time and return the depth of the dent at every point [mm], (n,).

        Args:
            elapsed_s: Time since the last call.
            tip_mm: The tip now: (along the surface, below the resting surface); None: no tip is near.
        """
        if tip_mm is None or not self._along_mm[0] <= tip_mm[0] <= self._along_mm[-1]:
            return self.press(elapsed_s, None, None)
        return self.press(elapsed_s, np.abs(self._along_mm - tip_mm[0]), tip_mm[1])

    def press(self, elapsed_s: float, away_mm: Floats | None, depth_mm: float | None) -> Floats:
        """Advance in time, for points of any arrangement, and return the depth of the dent at each [mm].

        Args:
            elapsed_s: Time since the last call.
            away_mm: Distance of each point from the tip along the surface; None: no tip is near.
            depth_mm: Depth of the tip below the resting surface; None: no tip is near.
        """
        pressed_mm = self._pressed_mm(away_mm, depth_mm)
        free_mm = (1 - self._shape.prompt_share) * self._crept_mm
        dent_mm = np.maximum(free_mm, pressed_mm)
        self._crept_mm += (dent_mm - self._crept_mm) * -math.expm1(-elapsed_s / self._shape.relax_s)
        return dent_mm

    def _pressed_mm(self, away_mm: Floats | None, depth_mm: float | None) -> Floats:
        """Return the depth to which the tip presses each point."""
        if away_mm is None or depth_mm is None:
            self.is_pierced = False
            return np.zeros_like(self._along_mm)
        self.is_pierced = depth_mm > 0 and (self.is_pierced or depth_mm > self._shape.puncture_mm)
        share = self._shape.drag_share if self.is_pierced else 1.0
        return max(depth_mm, 0.0) * share * np.exp(-away_mm / self._shape.dent_mm)
