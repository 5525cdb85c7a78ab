"""Where light stops: evidence for metal and its shadow in each A-scan.

Turns a volume and its surfaces into log-likelihood ratios. Metal blocks all light, so below it there is only
noise: bright metal, or tissue, and then nothing. For each A-scan and each row the ratio compares "the
needle's upper side is here" with "no needle is here". Speckle has the same spread in grey values at any
brightness (their logarithm is recorded), so that sums of squares are enough.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptigraph.imaging import FloatImage, Floats
from haptigraph.messages import Image
from haptigraph.perception.native.volume_surfaces import row_sums
from haptigraph.perception.volume.cells import Cells
from haptigraph.perception.volume.scale import VolumeScale
from haptigraph.perception.volume.surfaces import SurfaceMaps

__all__ = [
    "MOST",
    "RPE_SHARES",
    "TissueProfile",
    "light_stops",
    "lit_maps",
    "shadow_scores",
    "tissue_profile",
]

SHARES = 48  # bins from ILM to RPE
BELOW_MM, BELOW_BINS = 0.01, 40  # size and number of bins below the RPE
ABOVE_MM, ABOVE_BINS = 0.03, 40  # the same above the ILM
BEHIND_METAL_MM = 0.014  # from the ridge's middle to where only noise is left
WHOLE_SHARES = np.linspace(0.1, 1.15, 24)
ILM_SHARES, RPE_SHARES = np.linspace(0.04, 0.25, 8), np.linspace(1.02, 1.15, 8)
MAX_SHADOW = 0.6  # a vessel darkens less
SOFT_MM = 0.02  # around the ILM, inside which metal is not brighter than tissue
ABSENT, MOST_METAL = 1.5, 12.0  # evidence of one A-scan against metal that is dark, and for bright metal
NEAR_LOSS = 1.5  # of evidence for 10 um between a surface and the row where it is bright
MOST, WRONG_ROW = 8.0, 10.0  # evidence of one A-scan: for a needle at all, and against a wrong row


class TissueProfile(NamedTuple):
    """Mean grey value of lit tissue by depth, relative to both surfaces."""

    grey: FloatImage
    """(ABOVE_BINS + SHARES + BELOW_BINS,)."""
    dark_grey: float
    sd_grey: float
    """Standard deviation of speckle and noise in one voxel."""

    def at(self, row: Floats, ilm_row: Floats, rpe_row: Floats, axial_mm: float) -> FloatImage:
        """Return the expected grey value at some rows; all arguments broadcast."""
        return np.asarray(self.grey[_bins(row, ilm_row, rpe_row, axial_mm)], np.float32)


def _bins(at_row: Floats, ilm_row: Floats, rpe_row: Floats, axial_mm: float) -> NDArray[np.int32]:
    """Return the bins of rows in a profile."""
    row, ilm, rpe = (np.asarray(array, np.float32) for array in (at_row, ilm_row, rpe_row))
    off = row - ilm
    inside = np.minimum(off * (np.float32(SHARES) / np.maximum(rpe - ilm, np.float32(1))), SHARES - 0.01)
    inside += np.maximum(row - rpe, 0) * np.float32(axial_mm / BELOW_MM)
    off *= np.float32(axial_mm / ABOVE_MM)
    bins = np.where(off < 0, off, inside)
    bins += np.float32(ABOVE_BINS)
    np.clip(bins, 0, ABOVE_BINS + SHARES + BELOW_BINS - 1, out=bins)
    return bins.astype(np.int32)  # all are positive, so that it rounds down


def tissue_profile(cells: Cells, maps: SurfaceMaps) -> TissueProfile:
    """Average the cells in which both surfaces are visible, by depth."""
    some = np.s_[::2, 1::2]
    lit = (maps.ilm.visible & maps.rpe.visible)[some]
    ilm_row = ((cells.first_row_mm - maps.ilm.height_mm) / cells.scale.axial_mm)[some][lit]
    rpe_row = ((cells.first_row_mm - maps.rpe.height_mm) / cells.scale.axial_mm)[some][lit]
    grey = cells.grey[:, *some][:, lit]
    count = ABOVE_BINS + SHARES + BELOW_BINS
    if not lit.any():
        return TissueProfile(np.full(count, cells.dark_grey, np.float32), cells.dark_grey, cells.sd_grey)
    rows = np.arange(float(len(grey)))[:, None]
    bins = _bins(rows, ilm_row, rpe_row, cells.scale.axial_mm).ravel()
    number = np.bincount(bins, minlength=count)
    total = np.bincount(bins, weights=grey.ravel(), minlength=count)
    mean = np.where(number > 0, total / np.maximum(number, 1), cells.dark_grey)
    return TissueProfile(np.maximum(mean, cells.dark_grey).astype(np.float32), cells.dark_grey, cells.sd_grey)


def lit_maps(cells: Cells, maps: SurfaceMaps, profile: TissueProfile) -> SurfaceMaps:
    """Return surfaces that are not visible where the tissue just below them is in a shadow."""
    if not maps.tissue_grey:
        return maps
    ilm = maps.ilm.visible & (shadow_scores(cells, maps, profile, ILM_SHARES) < MAX_SHADOW)
    rpe = maps.rpe.visible & (shadow_scores(cells, maps, profile, RPE_SHARES) < MAX_SHADOW)
    return maps._replace(ilm=maps.ilm.only_where(ilm), rpe=maps.rpe.only_where(rpe))


def shadow_scores(
    cells: Cells, maps: SurfaceMaps, profile: TissueProfile, shares: Floats = WHOLE_SHARES
) -> FloatImage:
    """Return how much darker than expected the tissue of each cell is, (n, k): 1 in a shadow, 0 where lit.

    Args:
        cells: The downsampled volume.
        maps: Surfaces.
        profile: Expected brightness.
        shares: Depths that are compared, from the ILM (0) to the RPE (1).
    """
    axial_mm = cells.scale.axial_mm
    ilm_row = (cells.first_row_mm - maps.ilm.height_mm) / axial_mm
    rpe_row = (cells.first_row_mm - maps.rpe.height_mm) / axial_mm
    rows = ilm_row + shares[:, None, None] * (rpe_row - ilm_row)
    nearest = np.clip(np.rint(rows), 0, len(cells.grey) - 1).astype(np.intp)
    grey = np.take_along_axis(cells.grey, nearest, axis=0)
    expected = profile.at(rows, ilm_row, rpe_row, axial_mm) - np.float32(profile.dark_grey)
    lost = (expected * (expected + np.float32(profile.dark_grey) - grey)).sum(axis=0)
    return np.asarray(lost / np.maximum((expected**2).sum(axis=0), 1.0), np.float32)


def light_stops(
    volume: Image,
    scale: VolumeScale,
    at: tuple[NDArray[np.intp], NDArray[np.intp]],
    surfaces_row: tuple[Floats, Floats],
    profile: TissueProfile,
) -> FloatImage:
    """Return the log-likelihood ratio of "metal begins at this row" against "no metal", (h, m).

    Args:
        volume: (h, n, w) grey.
        scale: Its size and scale.
        at: Slices and columns of the A-scans, (m,) each.
        surfaces_row: Rows of ILM and RPE there, (m,) each.
        profile: Expected brightness of tissue.
    """
    ilm_row, rpe_row = surfaces_row
    grey = np.ascontiguousarray(volume[:, at[0], at[1]], np.float32)
    rows = np.arange(float(len(grey)))[:, None]
    dark = np.float32(profile.dark_grey)
    expected = profile.at(rows, ilm_row, rpe_row, scale.axial_mm) - dark
    grey -= dark
    gain = np.asarray(expected * (expected / 2 - grey) / profile.sd_grey**2, np.float32)
    sums = row_sums(gain[:, None], 0, 0)[:, 0]
    behind = max(1, round(BEHIND_METAL_MM / scale.axial_mm))
    stops = sums[-1] - np.concatenate([sums[behind + 1 :], np.repeat(sums[-1:], behind, axis=0)])
    wide = row_sums(grey[:, None], 1, 1)[:, 0]
    ridge = (wide[3:] - wide[:-3]) / 3
    metal = np.maximum(ridge, 0) ** 2 / np.float32(profile.sd_grey**2) - np.float32(ABSENT)
    free = np.clip((ilm_row - rows) * np.float32(scale.axial_mm / SOFT_MM), 0, 1)
    stops += free * np.minimum(metal, np.float32(MOST_METAL))
    best = stops.max(axis=0)
    stops = np.maximum(stops - best, np.float32(-WRONG_ROW)) + np.clip(best, -MOST, MOST)
    return np.asarray(_tolerant(stops, NEAR_LOSS * scale.axial_mm / 0.01), np.float32)


def _tolerant(stops: FloatImage, loss: float) -> FloatImage:
    """Give each row the evidence of rows nearby, less a loss for each row between, (h, m).

    A steep surface is blurred over many rows, and bright anywhere among them.
    """
    for step in (slice(1, None), slice(None, -1)):
        other = slice(None, -1) if step.start else slice(1, None)
        near = stops.copy()
        for _ in range(4):
            near[step] = np.maximum(near[step], near[other] - np.float32(loss))
        stops = near
    return stops
