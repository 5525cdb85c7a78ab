"""How far the tip of a bevelled needle lies below the line of its shaft.

Turns an image (px) and the column of the tip into a distance along the beam. The bright line of a shaft is
its wall towards the light. The point of the bevel may be on the far wall: visible as a bright spot below the
line, or, in tissue, by tissue in the light between both.
"""

from typing import NamedTuple

from haptigraph.geometry import Vec
from haptigraph.perception.native import bscan_needle as native
from haptigraph.perception.oct.scan_image import ScanImage

__all__ = ["BevelConstants", "Drop", "drop_in_tissue", "drop_in_vitreous"]


class BevelConstants(NamedTuple):
    """Constants of the search; lengths are axial unless they say lateral."""

    wall_mm: float = 0.165
    """From the shaft's line to the far wall of the thickest needle."""
    spot_mm: float = 0.03
    """A spot on the line, or the metal's own brightness, reaches so far below it."""
    above_mm: float = 0.046
    """Searched above the line."""
    smooth_mm: float = 0.0105
    """The window in which rows are averaged."""
    half_column_mm: float = 0.02
    """Lateral half width of the column in which a spot is searched."""
    bright_share: float = 0.6
    """Of the shaft's contrast, for a spot."""
    equal_share: float = 0.9
    """Of the upper spot's contrast; a fainter one may be a floater."""
    spot_sd_mm: float = 0.012
    """Of the end of a spot beside the line."""
    below_mm: float = 0.05
    """Searched for the dark below the far wall."""
    ahead_mm: tuple[float, float] = (0.031, 0.1)
    """Lateral, beyond it: tissue in full light."""
    lit_share: float = 0.75
    """Of the contrast of tissue in full light."""
    min_gain_mm: float = 0.16
    """Axial extent times the variance that the end of the light explains, in variances of the noise."""
    apart_mm: float = 0.01
    """So far apart, rows differ by noise that is independent, in scans of any resolution."""


CONSTANTS = BevelConstants()


class Drop(NamedTuple):
    """Distance of the tip below the shaft's line, along the beam."""

    rows: float = 0.0
    sd_rows: float = 0.0


def drop_in_vitreous(scan: ScanImage, at_px: Vec, ilm_px: float, typical_grey: float) -> Drop:
    """Return the drop of a tip above the retina.

    Args:
        scan: The B-scan.
        at_px: Where the shaft's line crosses the tip's column.
        ilm_px: Row of the ILM there.
        typical_grey: Contrast of the shaft against its sides.
    """
    return Drop(*native.drop_in_vitreous(scan.image, _search(scan), at_px, ilm_px, typical_grey))


def drop_in_tissue(scan: ScanImage, at_px: Vec, side: float) -> Drop:
    """Return the drop of a tip in tissue: where, in its column, tissue in the light ends.

    Args:
        scan: The B-scan.
        at_px: Where the shaft's line crosses the tip's column.
        side: 1 if the needle comes from the left, else -1.
    """
    return Drop(*native.drop_in_tissue(scan.image, _search(scan), at_px, side))


def _search(scan: ScanImage) -> native.BevelSearch:
    """Return the limits in rows and columns."""
    lateral_mm, axial_mm = scan.scale
    near_mm, far_mm = CONSTANTS.ahead_mm
    return native.BevelSearch(
        wall_rows=CONSTANTS.wall_mm / axial_mm,
        spot_rows=CONSTANTS.spot_mm / axial_mm,
        above_rows=CONSTANTS.above_mm / axial_mm,
        below_rows=CONSTANTS.below_mm / axial_mm,
        smooth_rows=max(1.0, CONSTANTS.smooth_mm / axial_mm),
        half_px=CONSTANTS.half_column_mm / lateral_mm,
        ahead_px=(near_mm / lateral_mm, far_mm / lateral_mm),
        bright_share=CONSTANTS.bright_share,
        equal_share=CONSTANTS.equal_share,
        spot_sd_rows=CONSTANTS.spot_sd_mm / axial_mm,
        lit_share=CONSTANTS.lit_share,
        min_gain=CONSTANTS.min_gain_mm / axial_mm,
        floor_grey=scan.levels.dark_grey,
        apart_rows=max(1, round(CONSTANTS.apart_mm / axial_mm)),
    )
