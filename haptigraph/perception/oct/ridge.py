"""Ridges in a B-scan: thin bright lines on dark speckle that may be a needle's shaft.

Turns an image (px) into straight lines, each with its brightness along the line. A ridge is brighter than
both of its sides, unlike the edge of a layer. Its shadow decides whether it is a needle or the ghost of one.
"""

import math
from functools import lru_cache
from typing import NamedTuple

from haptigraph.geometry import Vec
from haptigraph.perception.native.bscan_needle import (
    ALONG_STEPS,
    CORE_STEPS,
    RidgeLine,
    RidgeSearch,
)
from haptigraph.perception.oct.scan_image import STEP_MM, ScanImage, ScanScale

__all__ = ["Ridge", "RidgeConstants", "ridge_search"]


class RidgeConstants(NamedTuple):
    """Constants of the search for ridges."""

    side_mm: float = 0.094
    """From the ridge to its dark sides, in the downsampled image; axially in proportion."""
    min_contrast_sd: float = 3.5
    min_contrast_grey: float = 14.0
    """Above both sides."""
    lowest_deg: float = 6.0
    highest_deg: float = 81.0
    """Slope of a shaft in millimetres."""
    votes: int = 12
    """Least number of bright cells on a line."""
    erased_mm: float = 0.035
    """A ridge accounts for bright cells so far beside it."""
    below_ilm_mm: float = 0.04
    """Ridges are searched down to here."""
    inlier_mm: float = 0.0075
    """From the line, of the ridge's centre."""
    gap_mm: float = 0.12
    run_mm: float = 0.06
    """A longer gap ends a ridge, after a run of this length: so far, a line may cross a thick ridge."""
    beyond_mm: float = 0.45
    """Kept beyond the end of a ridge."""


CONSTANTS = RidgeConstants()


class Ridge(NamedTuple):
    """A straight line from its entry into the image downwards, with its brightness at every step along it."""

    line: RidgeLine
    step_px: float

    def at_px(self, steps: float) -> Vec:
        """Return the point at a distance along the line."""
        (x, y), (dx, dy) = self.line.start_px, self.line.along_px
        return x + steps * self.step_px * dx, y + steps * self.step_px * dy

    def steps_at_column(self, x_px: float) -> float:
        """Return the distance along the line at which it crosses a column."""
        return (x_px - self.line.start_px[0]) / (self.line.along_px[0] or 1e-9) / self.step_px

    @property
    def side(self) -> float:
        """1 if the line comes from the left, else -1."""
        return math.copysign(1.0, self.line.along_px[0])


def ridge_search(scan: ScanImage, dark_grey: float) -> RidgeSearch:
    """Return the limits of the search for ridges.

    Args:
        scan: The B-scan.
        dark_grey: Largest grey value beside a needle.
    """
    limits, sd_grey = _limits(scan.scale, *scan.cell_px), scan.pixel_sd_grey
    core_px = max(ALONG_STEPS * CORE_STEPS * limits.step_px**2, 1.0)

    def least_grey(averaged_px: float) -> float:
        return max(CONSTANTS.min_contrast_grey, CONSTANTS.min_contrast_sd * sd_grey / math.sqrt(averaged_px))

    return limits._replace(
        dark_grey=dark_grey,
        mask_grey=least_grey(4 * limits.across * limits.down),
        strip_grey=least_grey(core_px),
    )


@lru_cache
def _limits(scale: ScanScale, across: float, down: float) -> RidgeSearch:
    """Return the limits for cells of so many pixels, those of grey still 0."""

    def steps(length_mm: float) -> int:
        return round(length_mm / STEP_MM)

    aspect = scale.lateral_mm / scale.axial_mm
    return RidgeSearch(
        step_px=STEP_MM / scale.mean_mm,
        dark_grey=0.0,
        mask_grey=0.0,
        strip_grey=0.0,
        lowest_slope=math.tan(math.radians(CONSTANTS.lowest_deg)) * aspect,
        highest_slope=math.tan(math.radians(CONSTANTS.highest_deg)) * aspect,
        inlier_steps=CONSTANTS.inlier_mm / STEP_MM,
        below_ilm_px=CONSTANTS.below_ilm_mm / scale.axial_mm,
        across=across,
        down=down,
        side=max(2, round(CONSTANTS.side_mm / (across * scale.lateral_mm))),
        votes=CONSTANTS.votes,
        erased=max(1, round(CONSTANTS.erased_mm / math.sqrt(across * down) / scale.mean_mm)),
        gap=steps(CONSTANTS.gap_mm),
        run=steps(CONSTANTS.run_mm),
        beyond=steps(CONSTANTS.beyond_mm),
    )
