"""The needle in a volume with tissue: axis, tip, bevel and gap in 3D, each with its standard deviation.

    found = find_needle_and_surfaces(volume, VolumeScale(h, n, w, axial_mm, slice_mm, lateral_mm))
    found.ilm, found.rpe             # height maps
    found.needle                     # None, or line, tip and bevel; the tip is None where it is not certain

Needs no model of the instrument: a needle is bright, straight, thin, enters from a border of the volume, and
blocks all light. The end of the metal and the end of its shadow, and the height at which light stops, give
the tip, inside tissue too (`fit`). A tip that may as well be elsewhere is not reported.
"""

import math
from typing import NamedTuple

import numpy as np

from haptigraph.imaging import Floats
from haptigraph.messages import Image
from haptigraph.perception.volume.cells import Cells, downsampled
from haptigraph.perception.volume.fit import NeedleFit, fit_needle
from haptigraph.perception.volume.light import (
    RPE_SHARES,
    TissueProfile,
    lit_maps,
    shadow_scores,
    tissue_profile,
)
from haptigraph.perception.volume.scale import VolumeScale
from haptigraph.perception.volume.shaft_line import ShaftLine, find_shaft_line
from haptigraph.perception.volume.surfaces import HeightMap, SurfaceMaps, find_surface_maps

__all__ = ["FoundNeedle", "VolumeFindings", "entry_mm", "find_needle_and_surfaces", "find_surfaces"]

MAX_TIP_SD_MM = 0.024  # of one axis; a tip less certain is not reported
MIN_SCORE = 0.72  # of the fit, of 1; a worse one may be elsewhere
LEAST_SCORE = 0.45  # of a needle at all: vessels below floaters fit worse
POOR_DIRECTION_SD_DEG = 5.0  # of such a fit, at least
MIN_UPRIGHT = 0.6  # a sharp end beside the axis is thin, and below an overhang it is hidden
MIN_FACING = 0.8  # length of the bevel's mean direction


class FoundNeedle(NamedTuple):
    """A needle, eye frame."""

    start_mm: Floats
    """Where the axis enters the volume, (3,)."""
    end_mm: Floats
    """The point of the axis beside the tip; without a tip, beside the last metal, (3,)."""
    along: Floats
    """Direction of the axis towards the tip, length 1, (3,)."""
    direction_sd_deg: float
    """Standard deviation of the direction, in each of two perpendicular planes."""
    radius_mm: float
    tip_mm: Floats | None
    """The sharp end, (3,); None: its place is not certain."""
    tip_cov_mm2: Floats
    """Covariance of the tip, (3, 3)."""
    facing: Floats | None
    """Direction to which the bevel opens, length 1, (3,); None: not certain."""
    confidence: float
    """Share of the evidence that the needle's A-scans could give, 0 to 1."""

    @property
    def tip_sd_mm(self) -> Floats:
        """Standard deviation of the tip along x, y and z, (3,)."""
        return np.sqrt(np.diag(self.tip_cov_mm2))


class VolumeFindings(NamedTuple):
    """What is found in one volume."""

    ilm: HeightMap
    rpe: HeightMap
    needle: FoundNeedle | None


def find_needle_and_surfaces(volume: Image, scale: VolumeScale) -> VolumeFindings:
    """Find ILM, RPE and needle.

    Args:
        volume: (h, n, w) grey.
        scale: Its size and scale.
    """
    cells = downsampled(volume, scale)
    maps, profile = _lit_surfaces(cells)
    shadow = shadow_scores(cells, maps, profile)
    floor = shadow_scores(cells, maps, profile, RPE_SHARES)
    line = find_shaft_line(cells, maps, shadow, floor)
    if line is None:
        return VolumeFindings(maps.ilm, maps.rpe, None)
    fit = fit_needle(volume, scale, maps, profile, line)
    if fit.score < LEAST_SCORE:
        return VolumeFindings(maps.ilm, maps.rpe, None)
    return VolumeFindings(maps.ilm, maps.rpe, _needle(scale, line, fit))


def find_surfaces(volume: Image, scale: VolumeScale) -> VolumeFindings:
    """Find ILM and RPE alone; the arguments are those above."""
    maps, _ = _lit_surfaces(downsampled(volume, scale))
    return VolumeFindings(maps.ilm, maps.rpe, None)


def _lit_surfaces(cells: Cells) -> tuple[SurfaceMaps, TissueProfile]:
    maps = find_surface_maps(cells)
    profile = tissue_profile(cells, maps)
    return lit_maps(cells, maps, profile), profile


def _needle(scale: VolumeScale, line: ShaftLine, fit: NeedleFit) -> FoundNeedle:
    """Return a needle, without its tip where that is not certain."""
    sd_mm = np.sqrt(np.diag(fit.tip_cov_mm2))
    is_certain = (
        bool(sd_mm.max() <= MAX_TIP_SD_MM)
        and fit.score >= MIN_SCORE
        and _uprightness(fit) >= MIN_UPRIGHT
        and _contains(scale, fit)
    )
    length = float(np.linalg.norm(fit.facing))
    facing = fit.facing / length if is_certain and length >= MIN_FACING else None
    if is_certain:
        end_mm = fit.axis_mm + ((fit.tip_mm - fit.axis_mm) @ fit.along) * fit.along
    else:
        step = line.last_mm - float((fit.axis_mm - line.at_mm)[[0, 2]] @ line.along)
        end_mm = fit.axis_mm + fit.along * step / max(float(np.hypot(fit.along[0], fit.along[2])), 1e-6)
    return FoundNeedle(
        start_mm=entry_mm(scale, end_mm, fit.along),
        end_mm=end_mm,
        along=fit.along,
        direction_sd_deg=max(fit.direction_sd_deg, POOR_DIRECTION_SD_DEG * (fit.score < MIN_SCORE)),
        radius_mm=fit.radius_mm,
        tip_mm=fit.tip_mm if is_certain else None,
        tip_cov_mm2=fit.tip_cov_mm2,
        facing=facing,
        confidence=min(max(fit.score, 0.0), 1.0),
    )


def _uprightness(fit: NeedleFit) -> float:
    """Return 1 for a bevel that faces up or down, 0 for one that faces sideways."""
    upper = np.array([0.0, 1.0, 0.0]) - fit.along[1] * fit.along
    return abs(float(fit.facing @ upper)) / max(
        float(np.linalg.norm(upper) * np.linalg.norm(fit.facing)), 1e-9
    )


def _half_mm(scale: VolumeScale) -> Floats:
    """Return half the size of the volume along x, y and z, (3,)."""
    return (
        np.array(
            [scale.columns * scale.lateral_mm, scale.rows * scale.axial_mm, scale.slices * scale.slice_mm]
        )
        / 2
    )


def _contains(scale: VolumeScale, fit: NeedleFit) -> bool:
    """Return whether the tip is inside the volume, not at its border."""
    margin = np.array([2 * scale.lateral_mm, 2 * scale.axial_mm, scale.slice_mm])
    return bool((np.abs(fit.tip_mm) < _half_mm(scale) - margin).all())


def entry_mm(scale: VolumeScale, end_mm: Floats, along: Floats) -> Floats:
    """Return where the axis enters the volume, (3,)."""
    half = _half_mm(scale)
    way = [
        (half[axis] * math.copysign(1.0, -along[axis]) - end_mm[axis]) / -along[axis]
        for axis in range(3)
        if abs(along[axis]) > 1e-9
    ]
    return np.asarray(end_mm - along * max(min(way), 0.0), np.float64)
