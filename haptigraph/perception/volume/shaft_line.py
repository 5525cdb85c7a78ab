"""The shaft of a needle in a volume: a bright line in 3D that enters from a border and casts a shadow.

Turns a downsampled volume and its surfaces into one line, or none. Cells whose tissue is dark, with something
bright above it, are points; the line with most of them wins (RANSAC: Fischler and Bolles 1981). A line
without a shadow is a ghost or a vessel; one that does not reach a border is a floater.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from haptigraph.imaging import FloatImage, Floats
from haptigraph.perception.volume.cells import Cells
from haptigraph.perception.volume.surfaces import SurfaceMaps

__all__ = ["ShaftLine", "find_shaft_line"]

MIN_SHADOW = 0.55  # share of the tissue's brightness that is missing in a shadow
MIN_METAL_GREY = 22.0  # of metal above its dark surroundings
ABOVE_ILM_MM = 0.02
ACROSS_MM, VERTICAL_MM = 0.075, 0.05  # largest distances of a point from its line
MIN_POINTS, MIN_LENGTH_MM = 8, 0.25
MIN_SLOPE, MAX_SLOPE = 0.2, 4.0  # of height over the horizontal: 11 to 76 degrees
MAX_BORDER_MM = 0.2  # between the first point and the border of the volume
MAX_GAP_MM = 0.2  # between two points along the line
MIN_SHADOW_SHARE = 0.6  # of the cells below the shaft
MAX_LIT_SHADOW = 0.45  # of the RPE's brightness that is missing where it is lit
BACK_MM, AHEAD_MM, STATION_MM = 0.2, 2.0, 0.04  # around the last metal, where the shadow's end is looked for
PAIRS, SEED = 400, 5
RADIUS_MM = 0.055  # of a needle, until it is estimated


class ShaftLine(NamedTuple):
    """The upper side of a shaft, along a horizontal coordinate s [mm] that grows towards the tip."""

    at_mm: Floats
    """The point at s = 0, eye frame, (3,)."""
    along: Floats
    """Horizontal direction (x, z), length 1, (2,)."""
    slope: float
    """Change of height over s; negative."""
    first_mm: float
    """s of the first point, near the border."""
    last_mm: float
    """s of the last point: the metal is visible at least so far."""
    shadow_mm: float
    """s at which the shadow ends."""


def find_shaft_line(
    cells: Cells, maps: SurfaceMaps, shadow: FloatImage, floor: FloatImage
) -> ShaftLine | None:
    """Return the shaft; None if there is none.

    Args:
        cells: The downsampled volume.
        maps: Surfaces.
        shadow: From `light.shadow_scores`.
        floor: The same of the RPE alone, which the whole needle hides, also deep in the retina.
    """
    points = _points(cells, maps, shadow)
    if len(points) < MIN_POINTS:
        return None
    chosen = _best_pair(points)
    if chosen is None:
        return None
    for _ in range(3):
        at, along, slope, inliers = _fitted(points, chosen)
        if len(inliers) < MIN_POINTS:
            return None
        chosen = inliers
    return _checked(cells, shadow, floor, points, (at, along, slope, chosen))


def _points(cells: Cells, maps: SurfaceMaps, shadow: FloatImage) -> Floats:
    """Return bright points above dark tissue, (k, 3), eye frame."""
    number, cell = np.nonzero(shadow > MIN_SHADOW)
    ilm_row = (cells.first_row_mm - maps.ilm.height_mm[number, cell]) / cells.scale.axial_mm
    grey = cells.grey[:, number, cell] - np.float32(cells.dark_grey)
    smooth = grey.copy()
    smooth[1:-1] = (grey[:-2] + grey[1:-1] + grey[2:]) / 3
    rows = np.arange(len(grey))[:, None]
    smooth[rows > ilm_row - ABOVE_ILM_MM / cells.scale.axial_mm] = -np.inf
    best = smooth.argmax(axis=0)
    is_metal = smooth[best, np.arange(len(best))] > MIN_METAL_GREY
    at = np.stack([cells.x_mm[cell], cells.height_mm(best.astype(float)), cells.scale.z_mm[number]], axis=1)
    return np.asarray(at[is_metal], np.float64)


def _best_pair(points: Floats) -> NDArray[np.intp] | None:
    """Return the points near the best line through two of them."""
    rng = np.random.default_rng(SEED)
    first, second = rng.integers(0, len(points), (2, PAIRS))
    flat = points[second][:, (0, 2)] - points[first][:, (0, 2)]
    length = np.hypot(*flat.T)
    slope = (points[second, 1] - points[first, 1]) / np.maximum(length, 1e-9)
    usable = (length > MIN_LENGTH_MM / 2) & (np.abs(slope) > MIN_SLOPE) & (np.abs(slope) < MAX_SLOPE)
    if not usable.any():
        return None
    first, along, slope = first[usable], flat[usable] / length[usable, None], slope[usable]
    off = points[None] - points[first][:, None]
    s = off[..., 0] * along[:, :1] + off[..., 2] * along[:, 1:]
    across = off[..., 2] * along[:, :1] - off[..., 0] * along[:, 1:]
    down = off[..., 1] - slope[:, None] * s
    near = (np.abs(across) < ACROSS_MM) & (np.abs(down) < VERTICAL_MM)
    return np.flatnonzero(near[near.sum(axis=1).argmax()])


def _fitted(points: Floats, chosen: NDArray[np.intp]) -> tuple[Floats, Floats, float, NDArray[np.intp]]:
    """Fit a line to points; return a point, its direction, its slope, and the points near it."""
    some = points[chosen]
    middle = some.mean(axis=0)
    flat = (some - middle)[:, (0, 2)]
    along = np.linalg.svd(flat, full_matrices=False)[2][0]
    s = flat @ along
    slope, offset = np.polyfit(s, some[:, 1] - middle[1], 1)
    if slope > 0:
        along, slope = -along, -slope
    off = points - middle
    s = off[:, (0, 2)] @ along
    across = off[:, 2] * along[0] - off[:, 0] * along[1]
    down = off[:, 1] - offset - slope * s
    near = np.flatnonzero((np.abs(across) < ACROSS_MM) & (np.abs(down) < VERTICAL_MM))
    return middle + np.array([0.0, offset, 0.0]), along, float(slope), near


def _checked(
    cells: Cells,
    shadow: FloatImage,
    floor: FloatImage,
    points: Floats,
    line: tuple[Floats, Floats, float, NDArray[np.intp]],
) -> ShaftLine | None:
    """Return a line with its ends; None if it is too short, enters from nowhere or casts no shadow."""
    at, along, slope, chosen = line
    s = np.sort((points[chosen] - at)[:, (0, 2)] @ along)
    gaps = np.flatnonzero(np.diff(s) > MAX_GAP_MM)
    if len(gaps):  # keep the longest part
        edges = np.concatenate(([0], gaps + 1, [len(s)]))
        longest = int(np.diff(edges).argmax())
        s = s[edges[longest] : edges[longest + 1]]
    first_mm, last_mm = float(s[0]), float(s[-1])
    if len(s) < MIN_POINTS or last_mm - first_mm < MIN_LENGTH_MM or not -MAX_SLOPE < slope < -MIN_SLOPE:
        return None
    if _to_border_mm(cells, at, along, slope, first_mm) > MAX_BORDER_MM:
        return None
    shadow_mm = _shadow_end(cells, shadow, floor, at, along, first_mm, last_mm)
    return None if shadow_mm is None else ShaftLine(at, along, slope, first_mm, last_mm, shadow_mm)


def _to_border_mm(cells: Cells, at: Floats, along: Floats, slope: float, s: float) -> float:
    """Return how far it is, back along the line, from s to the border of the volume."""
    here = at + s * np.array([along[0], slope, along[1]])
    back = -np.array([along[0], slope, along[1]])
    top_mm = cells.first_row_mm
    ends = (
        (cells.x_mm[0], cells.x_mm[-1]),
        (-np.inf, top_mm),
        (cells.scale.z_mm[0], cells.scale.z_mm[-1]),
    )
    way = [
        ((high if step > 0 else low) - place) / step if abs(step) > 1e-9 else np.inf
        for place, step, (low, high) in zip(here, back, ends, strict=True)
    ]
    return float(max(min(way), 0.0))


def _shadow_end(
    cells: Cells,
    shadow: FloatImage,
    floor: FloatImage,
    at: Floats,
    along: Floats,
    first_mm: float,
    last_mm: float,
) -> float | None:
    """Return s at the end of the shadow; None if the shaft casts none."""
    z, x = np.meshgrid(cells.scale.z_mm - at[2], cells.x_mm - at[0], indexing="ij")
    s, across = x * along[0] + z * along[1], z * along[0] - x * along[1]
    near = np.abs(across) < 0.8 * RADIUS_MM
    body = shadow[near & (s >= first_mm) & (s <= last_mm)]
    if not len(body) or float((body > MIN_SHADOW).mean()) < MIN_SHADOW_SHARE:
        return None
    stations = np.arange(last_mm - BACK_MM, last_mm + AHEAD_MM, STATION_MM)
    number = np.floor((s[near] - stations[0]) / STATION_MM).astype(int)
    inside = (number >= 0) & (number < len(stations))
    count = np.bincount(number[inside], minlength=len(stations))
    total = np.bincount(number[inside], weights=floor[near][inside], minlength=len(stations))
    mean = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    lit, inside_volume = np.flatnonzero(mean < MAX_LIT_SHADOW), np.flatnonzero(count)
    if len(lit):
        return float(stations[lit[0]])
    return float(stations[inside_volume[-1]] + STATION_MM) if len(inside_volume) else last_mm
