"""Tissue that a tip presses in and that springs back: one law for both phantoms.

Turns time and the tip's place along a surface into how deep that is pressed in. Each place is a standard
linear solid (Zener 1948, Elasticity and Anelasticity of Metals): a spring beside a spring and a dashpot in
series, so that a released surface jumps back in part and creeps back for the rest. How far a dent reaches is
a stretched membrane on a bed of springs (Winkler 1867): it falls off exponentially from the tip. That the
retina is viscoelastic: Ferrara et al. 2021, Eye 35(7). How much the retina gives before the tip goes through,
and the time constant, differ between eyes and are set by a scenario: nobody measured them in a living eye.
Knows no images and no force.
"""

import math
from typing import Annotated, TypeAlias

import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from haptigraph.geometry import Vec

__all__ = ["Columns", "Dent", "Share", "TissueShape"]

Columns: TypeAlias = NDArray[np.float64]
Share: TypeAlias = Annotated[float, Meta(ge=0, le=1)]


class TissueShape(Struct, frozen=True, forbid_unknown_fields=True):
    """How tissue gives: the [tissue] table of a scenario; of B-scans, part of their [retina] table."""

    dent_mm: Annotated[float, Meta(ge=0.05, le=3)] = 0.45
    """A dent is 1/e as deep so far beside the tip."""
    puncture_mm: Annotated[float, Meta(ge=0, le=1)] = 0.08
    """The tip goes through when it has pushed the surface in so deep."""
    drag_share: Share = 0.3
    """Of the tip's depth below the resting surface: what that stays pushed in by once the tip is through."""
    prompt_share: Share = 0.6
    """Of a dent: what springs back at once when it is released."""
    relax_s: Annotated[float, Meta(ge=0.01, le=60)] = 0.6
    """Time constant of the dashpot."""


class Dent:
    """What a tip does to one surface.

    Args:
        shape: How it gives.
        along_mm: Places along the surface at rest, rising, (n,).
    """

    def __init__(self, shape: TissueShape, along_mm: Columns) -> None:
        self._shape, self._along_mm = shape, along_mm
        self.restart()

    def restart(self) -> None:
        """Lie at rest."""
        self._crept_mm = np.zeros_like(self._along_mm)
        self.is_pierced = False
        """Whether the tip is through the surface."""

    def advance(self, elapsed_s: float, tip_mm: Vec | None) -> Columns:
        """Move on, and return how deep every place is pressed in [mm], (n,).

        Args:
            elapsed_s: Since the moment before.
            tip_mm: The tip now: (along the surface, below its rest); None: there is none near.
        """
        held_mm = self._held_mm(tip_mm)
        free_mm = (1 - self._shape.prompt_share) * self._crept_mm
        dent_mm = np.maximum(free_mm, held_mm)
        self._crept_mm += (dent_mm - self._crept_mm) * -math.expm1(-elapsed_s / self._shape.relax_s)
        return dent_mm

    def _held_mm(self, tip_mm: Vec | None) -> Columns:
        """Return how deep the tip holds each place down."""
        if tip_mm is None or not self._along_mm[0] <= tip_mm[0] <= self._along_mm[-1]:
            self.is_pierced = False
            return np.zeros_like(self._along_mm)
        at_mm, depth_mm = tip_mm
        self.is_pierced = depth_mm > 0 and (self.is_pierced or depth_mm > self._shape.puncture_mm)
        share = self._shape.drag_share if self.is_pierced else 1.0
        return max(depth_mm, 0.0) * share * np.exp(-np.abs(self._along_mm - at_mm) / self._shape.dent_mm)
