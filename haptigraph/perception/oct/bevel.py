"""How far the tip of a bevelled needle lies below the line of its shaft.

Turns an image (px) and the column of the tip into a distance along the beam. The bright line of a shaft is
its wall towards the light. The point of the bevel may be on the far wall: visible as a bright spot below the
line, or, in tissue, by tissue in the light between both.
"""

from typing import NamedTuple

import numpy as np

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats
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
    half_column_mm: float = 0.016
    """Lateral half width of the column in which a spot is searched."""
    bright_share: float = 0.6
    """Of the shaft's contrast, for a spot."""
    equal_share: float = 0.8
    """Of the upper spot's contrast; a fainter one may be a floater."""
    spot_sd_mm: float = 0.012
    """Of the end of a spot beside the line."""
    below_mm: float = 0.05
    """Searched for the dark below the far wall."""
    ahead_mm: tuple[float, float] = (0.031, 0.1)
    """Lateral, beyond it: tissue in full light."""
    lit_share: float = 0.75
    """Of the contrast of tissue in full light."""
    min_gain: float = 80.0
    """Of the variance that the end of the light explains, in variances of a row."""


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
    axial_mm, (height, width) = scan.scale.axial_mm, scan.image.shape
    x, y = min(max(round(at_px[0]), 0), width - 1), round(at_px[1])
    half = round(CONSTANTS.half_column_mm / scan.scale.lateral_mm)
    top = max(y - round(CONSTANTS.above_mm / axial_mm), 0)
    bottom = round(min(y + CONSTANTS.wall_mm / axial_mm, ilm_px - 2, height))
    if bottom - top < 6:
        return Drop()
    part = scan.image[top:bottom, max(x - half, 0) : x + half + 1].mean(axis=1)
    profile = part - scan.levels.dark_grey
    vitreous_grey = max(float(np.sort(profile)[len(profile) // 4]), 0.0)
    profile[1:-1] = (profile[:-2] + profile[1:-1] + profile[2:]) / 3
    spot_rows = CONSTANTS.spot_mm / axial_mm
    is_bright = profile > vitreous_grey + CONSTANTS.bright_share * typical_grey
    bright = np.flatnonzero(is_bright).tolist()
    runs: list[list[int]] = []
    for row in bright:
        if runs and row - runs[-1][-1] <= max(2, round(spot_rows / 3)):
            runs[-1].append(row)
        else:
            runs.append([row])
    spots = [_spot(profile, run, top - at_px[1]) for run in runs]
    return _drop_of(spots, spot_rows, CONSTANTS.spot_sd_mm / axial_mm)


class _Spot(NamedTuple):
    """A bright run of rows, counted from the shaft's line."""

    start_rows: float
    end_rows: float
    grey: float


def _spot(profile: Floats, run: list[int], top: float) -> _Spot:
    """Return a run with its lower end at half of its brightness, sub-pixel."""
    peak = run[0] + int(profile[run[0] : run[-1] + 1].argmax())
    grey = float(profile[peak])
    dark = np.flatnonzero(profile[peak:] <= grey / 2)
    end = len(profile) - 1.0
    if len(dark):
        at = peak + int(dark[0])
        end = at - 1 + float((profile[at - 1] - grey / 2) / max(profile[at - 1] - profile[at], 1e-6))
    return _Spot(top + run[0], top + end, grey)


def _drop_of(spots: list[_Spot], spot_rows: float, sd_rows: float) -> Drop:
    """Return the drop of the lowest spot that belongs to the metal.

    Args:
        spots: From top to bottom.
        spot_rows: A spot on the line reaches so far below it.
        sd_rows: Standard deviation of the end of a spot.
    """
    upper = [spot for spot in spots if spot.start_rows <= spot_rows]
    lower = [spot for spot in spots if spot.start_rows > spot_rows]
    end = upper[-1].end_rows if upper else 0.0
    drop = Drop(end, sd_rows) if end > spot_rows else Drop(0.0, end / 2 if end > spot_rows / 2 else 0.0)
    if not lower:
        return drop
    other = max(lower, key=lambda spot: spot.grey)
    # A bevel's second part, or a floater: what the tip may be, its uncertainty covers.
    sd_rows = max((other.end_rows - drop.rows) / 2, sd_rows)
    is_metal = not upper or other.grey >= CONSTANTS.equal_share * max(spot.grey for spot in upper)
    return Drop(other.end_rows, sd_rows) if is_metal else Drop(drop.rows, sd_rows)


def drop_in_tissue(scan: ScanImage, at_px: Vec, side: float) -> Drop:
    """Return the drop of a tip in tissue: where, in its column, tissue in the light ends.

    Args:
        scan: The B-scan.
        at_px: Where the shaft's line crosses the tip's column.
        side: 1 if the needle comes from the left, else -1.
    """
    axial_mm, lateral_mm, (height, width) = scan.scale.axial_mm, scan.scale.lateral_mm, scan.image.shape
    top = round(at_px[1] + CONSTANTS.spot_mm / 2 / axial_mm)
    bottom = min(round(at_px[1] + (CONSTANTS.wall_mm + CONSTANTS.below_mm) / axial_mm), height)
    half = CONSTANTS.half_column_mm
    spans = (-half, half), CONSTANTS.ahead_mm
    columns = [sorted(round(at_px[0] + side * end / lateral_mm) for end in span) for span in spans]
    if bottom - top < 12 or min(columns[0] + columns[1]) < 0 or max(columns[0] + columns[1]) >= width:
        return Drop()
    here, full = (scan.image[top:bottom, left : right + 1].mean(axis=1) for left, right in columns)
    loss = full - here
    count = np.arange(1, len(loss))
    sums = np.cumsum(loss)[:-1]
    upper, lower = sums / count, (sums[-1] + loss[-1] - sums) / (len(loss) - count)
    gain = np.where(lower > upper, count * (len(loss) - count) / len(loss) * (lower - upper) ** 2, 0)
    end = int(gain.argmax())
    drop = top + end + 0.5 - at_px[1]
    is_lit = upper[end] < (1 - CONSTANTS.lit_share) * (float(full[: end + 1].mean()) - scan.levels.dark_grey)
    is_clear = gain[end] > CONSTANTS.min_gain * float(np.var(np.diff(loss))) / 2
    if not (is_lit and is_clear and drop * axial_mm > CONSTANTS.spot_mm):
        return Drop()
    return Drop(drop, drop / 3)
