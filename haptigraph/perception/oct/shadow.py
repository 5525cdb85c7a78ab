"""The edge of a needle's shadow on the tissue below it: where the metal ends, seen along the beam.

Turns an image (px), a shaft and the surfaces into the column in which a dark profile first rises.
"""

from functools import lru_cache
from typing import NamedTuple

from haptigraph.perception.native.bscan_needle import EdgeSearch, SurfacePair, shadow_edge
from haptigraph.perception.oct.ridge import Ridge
from haptigraph.perception.oct.scan_image import ScanImage, ScanScale
from haptigraph.perception.oct.surfaces import Surfaces

__all__ = ["Edge", "ShadowConstants", "find_shadow_edge"]


class ShadowConstants(NamedTuple):
    """Constants of the search for the shadow's edge; lengths are lateral unless they say axial."""

    margin_mm: float = 0.15
    """From the shaft's end back into the shadow; the metal may be visible beyond the edge."""
    window_mm: float = 0.37
    """Searched beyond visible tissue, from the shaft's end on."""
    thick_mm: float = 0.35
    """Axial depth of the retina where its floor is not visible."""
    max_distance_mm: float = 1.5
    """From the end of the continuous line to the visible tissue."""
    slope_mm: float = 0.28
    """A surface is extrapolated by the slope of its last part of this length."""
    max_extrapolation_mm: float = 0.066
    """Axial."""
    below_mm: float = 0.013
    """Axial, from the surface to the profile."""
    below_shaft_mm: float = 0.03
    """Axial, from the shaft to the profile."""
    deep_mm: float = 0.2
    """Axial extent of the profile."""
    shallow_mm: float = 0.035
    """The same above vessels."""
    below_rpe_mm: float = 0.06
    """Axial; deeper, tissue is dark."""
    run_mm: float = 0.062
    smooth_mm: float = 0.025
    min_contrast_grey: float = 22.0
    halved_grey: float = 50.0
    """Where half of the light passes each way, a contrast c falls to c / (c + this) of it: grey values are
    logarithmic, some 5 a decibel, and the noise stays."""
    rise_share: float = 0.8
    sd_mm: float = 0.0032
    """Smallest standard deviation of the edge."""
    shallow_sd_mm: float = 0.006
    """The same above vessels."""
    sd_share: float = 0.25
    """Of the edge's width, which adds to it."""


CONSTANTS = ShadowConstants()


class Edge(NamedTuple):
    """An edge of the shadow."""

    x_px: float
    sd_px: float


def find_shadow_edge(
    scan: ScanImage, ridge: Ridge, end_px: float, surfaces: Surfaces, *, shallow: bool = False
) -> Edge | None:
    """Return the edge of the shadow in the tissue below a shaft; None if there is none near its end.

    Args:
        scan: The B-scan.
        ridge: The shaft.
        end_px: Column in which its continuous part ends.
        surfaces: ILM and RPE.
        shallow: Use only tissue at the surface, which the shadow of a vessel does not reach.
    """
    lateral_mm = scan.scale.lateral_mm
    search = _limits(scan.scale, scan.column_px, shallow)._replace(
        start_px=ridge.line.start_px, along_px=ridge.line.along_px, end_px=end_px
    )
    found = shadow_edge(scan.image, search, SurfacePair(*surfaces[:5]))
    if found is None:
        return None
    x_px, width_px = found
    least_mm = CONSTANTS.shallow_sd_mm if shallow else CONSTANTS.sd_mm
    sd_mm = max(least_mm, CONSTANTS.sd_share * width_px * lateral_mm - CONSTANTS.sd_mm)
    return Edge(x_px, sd_mm / lateral_mm)


@lru_cache
def _limits(scale: ScanScale, column_px: int, shallow: bool) -> EdgeSearch:
    """Return the limits of the search below a shaft that is still to be set."""
    lateral_mm, axial_mm = scale
    return EdgeSearch(
        start_px=(0.0, 0.0),
        along_px=(0.0, 0.0),
        end_px=0.0,
        margin_px=CONSTANTS.margin_mm / lateral_mm,
        window_px=CONSTANTS.window_mm / lateral_mm,
        max_distance_px=CONSTANTS.max_distance_mm / lateral_mm,
        thick_rows=CONSTANTS.thick_mm / axial_mm,
        most_rows=CONSTANTS.max_extrapolation_mm / axial_mm,
        below_rows=0.0 if shallow else CONSTANTS.below_mm / axial_mm,
        below_shaft_rows=CONSTANTS.below_shaft_mm / axial_mm,
        deep_rows=(CONSTANTS.shallow_mm if shallow else CONSTANTS.deep_mm) / axial_mm,
        below_rpe_rows=CONSTANTS.below_rpe_mm / axial_mm,
        min_contrast_grey=CONSTANTS.min_contrast_grey,
        halved_grey=CONSTANTS.halved_grey,
        rise_share=CONSTANTS.rise_share,
        slope_columns=max(3, round(CONSTANTS.slope_mm / lateral_mm / column_px)),
        run=max(3, round(CONSTANTS.run_mm / lateral_mm)),
        half=max(1, round(CONSTANTS.smooth_mm / lateral_mm / 2)),
    )
