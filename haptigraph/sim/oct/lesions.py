"""Lesions of the simulated outer retina: drusen, detachments, subretinal fluid, cysts, atrophy.

Turns settings and a seed into profiles by column (mm), which deform the surfaces and tell `layers` what to
draw. Sizes follow the definitions of Spaide et al. 2020 (Ophthalmology 127(5)) and Sadda et al. 2018
(Ophthalmology 125(4)).
"""

import math
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta, Struct

from haptigraph.imaging import Floats, Mask
from haptigraph.sim.oct.retina import Surfaces

__all__ = ["COMPLEX_MM", "Cyst", "LesionProfiles", "LesionSettings", "lesion_profiles"]

Count = Annotated[int, Meta(ge=0, le=40)]
COMPLEX_MM, EPITHELIUM_MM = 0.065, 0.026
"""From the upper edge of the ellipsoid zone to Bruch's membrane; thickness of the RPE's band."""
FLUID_FROM_MM, FLUID_TO_MM = 0.004, 0.03  # where the RPE's own edge takes over from the ellipsoid zone's
SWELLING_SHARE = 0.7  # of a cyst's height, by which it raises the ILM


class LesionSettings(Struct, frozen=True, forbid_unknown_fields=True):
    """Number and size of the lesions; without any the retina is healthy."""

    drusen: Count = 0
    drusen_mm: Annotated[float, Meta(ge=0, le=0.3)] = 0.06
    """Height of the largest."""
    detachment_mm: Annotated[float, Meta(ge=0, le=0.6)] = 0.0
    """Height of a detachment of the pigment epithelium."""
    fluid_mm: Annotated[float, Meta(ge=0, le=0.6)] = 0.0
    """Height of subretinal fluid."""
    cysts: Count = 0
    cyst_mm: Annotated[float, Meta(ge=0, le=0.4)] = 0.1
    """Height of the largest cyst of intraretinal fluid."""
    atrophy_mm: Annotated[float, Meta(ge=0, le=10)] = 0.0
    """Width of a patch without RPE and photoreceptors."""
    foci: Count = 0
    """Number of small bright spots (exudates, migrated pigment) that cast a shadow."""
    pit_mm: Annotated[float, Meta(ge=0, le=0.25)] = 0.0
    """Depth of the foveal pit."""


class Cyst(NamedTuple):
    """An ellipse of intraretinal fluid."""

    x_mm: float
    share: float
    """Of the way from ILM to RPE."""
    half_width_mm: float
    half_height_mm: float


class LesionProfiles(NamedTuple):
    """Lesions by column, (w,) each."""

    lift_mm: Floats
    """Of the RPE above Bruch's membrane."""
    is_serous: Mask
    """Whether clear fluid, not drusen, is below the lifted RPE."""
    fluid_mm: Floats
    """Thickness of subretinal fluid."""
    atrophy: Floats
    """Share of the RPE that is lost, 0 to 1."""
    ilm_mm: Floats
    """Swelling, less the foveal pit, that raises the ILM."""
    cysts: tuple[Cyst, ...]

    def ilm_raised_mm(self) -> Floats:
        """Return by how much all lesions together raise the ILM, (w,)."""
        return self.lift_mm + self.fluid_mm + self.ilm_mm - COMPLEX_MM * self.atrophy

    def deformed(self, healthy: Surfaces) -> Surfaces:
        """Return the surfaces with lesions.

        The RPE is the ellipsoid zone's upper edge where the photoreceptors touch it, its own upper edge below
        fluid, and Bruch's membrane where it is lost.
        """
        own = np.clip((self.fluid_mm - FLUID_FROM_MM) / (FLUID_TO_MM - FLUID_FROM_MM), 0, 1)
        attached_mm = healthy.rpe_mm + self.lift_mm - COMPLEX_MM * self.atrophy
        detached_mm = healthy.rpe_mm + self.lift_mm - COMPLEX_MM + EPITHELIUM_MM * (1 - self.atrophy)
        rpe_mm = (attached_mm + self.fluid_mm) * (1 - own) + detached_mm * own
        return Surfaces(healthy.ilm_mm + self.ilm_raised_mm(), rpe_mm, healthy.is_pierced)


def lesion_profiles(settings: LesionSettings, x_mm: Floats, seed: int) -> LesionProfiles:
    """Draw the lesions' positions.

    Args:
        settings: Their number and size.
        x_mm: Positions of the columns, eye frame, ascending, (w,).
        seed: Random seed.
    """
    rng = np.random.default_rng((seed, 31))
    lift_mm, is_serous = _drusen(settings, x_mm, rng), np.zeros(len(x_mm), bool)
    if settings.detachment_mm:
        dome_mm = settings.detachment_mm * _dome(x_mm, rng, rng.uniform(0.4, 1.6))
        is_serous = (dome_mm > lift_mm) & bool(rng.integers(2))
        lift_mm = np.maximum(lift_mm, dome_mm)
    fluid_mm = settings.fluid_mm * _dome(x_mm, rng, rng.uniform(0.5, 2.5)) if settings.fluid_mm else 0 * x_mm
    atrophy = 0 * x_mm
    if settings.atrophy_mm:
        middle_mm = rng.uniform(x_mm[0], x_mm[-1])
        off_mm = np.abs(x_mm - middle_mm) - settings.atrophy_mm / 2
        atrophy = 1 / (1 + np.exp(np.clip(off_mm / rng.uniform(0.01, 0.06), -50, 50)))
        fluid_mm, lift_mm = fluid_mm * (1 - atrophy), lift_mm * (1 - 0.7 * atrophy)
    cysts = _cysts(settings, x_mm, rng)
    ilm_mm = 0 * x_mm
    for cyst in cysts:
        off = (x_mm - cyst.x_mm) / (1.5 * cyst.half_width_mm)
        ilm_mm = np.maximum(ilm_mm, 2 * SWELLING_SHARE * cyst.half_height_mm * np.exp(-(off**2)))
    pit = (x_mm - rng.uniform(x_mm[0], x_mm[-1])) / rng.uniform(0.3, 0.7)
    ilm_mm = ilm_mm - settings.pit_mm * np.exp(-(pit**2))
    return LesionProfiles(lift_mm, is_serous, fluid_mm, atrophy, ilm_mm, cysts)


def _drusen(settings: LesionSettings, x_mm: Floats, rng: np.random.Generator) -> Floats:
    height_mm = 0 * x_mm
    for _ in range(settings.drusen):
        half_mm, tall_mm = rng.uniform(0.03, 0.25), settings.drusen_mm * rng.uniform(0.2, 1.0)
        off = (x_mm - rng.uniform(x_mm[0], x_mm[-1])) / half_mm
        power = rng.uniform(1.5, 4)
        height_mm = np.maximum(height_mm, min(tall_mm, 1.2 * half_mm) * np.exp(-(np.abs(off) ** power)))
    return np.asarray(height_mm, np.float64)


def _dome(x_mm: Floats, rng: np.random.Generator, half_mm: float) -> Floats:
    """Return a dome of height 1 with a flat edge."""
    off = np.clip(np.abs(x_mm - rng.uniform(x_mm[0], x_mm[-1])) / half_mm, 0, 1)
    return np.asarray((1 - off ** rng.uniform(1.4, 3)) ** rng.uniform(1.0, 1.8), np.float64)


def _cysts(settings: LesionSettings, x_mm: Floats, rng: np.random.Generator) -> tuple[Cyst, ...]:
    middle_mm, spread_mm = rng.uniform(x_mm[0], x_mm[-1]), rng.uniform(0.2, 1.5)
    cysts = []
    for _ in range(settings.cysts):
        half_mm = settings.cyst_mm / 2 * rng.uniform(0.15, 1.0)
        at_mm, share = middle_mm + spread_mm * rng.normal(), rng.uniform(0.25, 0.85)
        cysts.append(Cyst(at_mm, share, half_mm * math.exp(rng.normal(0, 0.4)) + 0.01, half_mm))
    return tuple(cysts)
