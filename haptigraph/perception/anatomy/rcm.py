"""Estimate the needle's remote centre of motion (RCM): the point where its shaft lines meet [px]."""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats
from haptigraph.perception.anatomy.rim import Rim

__all__ = ["Rcm", "ShaftLine", "fit_rcm"]

MIN_LINES = 3
# Ratios are relative to the globe's radius.
MAX_OUTSIDE_RATIO = 0.18  # of an RCM, outside the inner edge
MAX_INSIDE_RATIO = 0.05  # and inside it
WALL_SD_RATIO = 0.02  # prior of an RCM's distance from the middle of the visible wall
MIN_LINE_SD_PX = 0.06
INDEPENDENT_LINES = 6  # at most: the errors of many images of one clip are correlated


class Rcm(Struct, frozen=True, eq=False):
    """A remote centre of motion."""

    point_px: Vec
    lines: int
    """How many shaft lines meet there."""
    residual_px: float
    """RMS distance of the lines from it."""
    radial_sd_px: float
    """Standard deviation along the globe's radius; large if the lines hardly turn."""

    def combined_with(self, other: "Rcm | None") -> "Rcm":
        """Return the inverse-variance-weighted mean of two measurements in the same images."""
        if other is None:
            return self
        better = min(self, other, key=lambda rcm: rcm.radial_sd_px)
        one, another = self.radial_sd_px**-2, other.radial_sd_px**-2
        point = (np.array(self.point_px) * one + np.array(other.point_px) * another) / (one + another)
        return replace(better, point_px=(float(point[0]), float(point[1])))


class ShaftLine(Struct, eq=False):
    """Centre line of a shaft in one image."""

    point_px: Floats
    """Middle of its visible part, (2,)."""
    along: Floats
    """Unit direction, (2,)."""
    length_px: float
    """Length of its visible part."""

    @property
    def normal(self) -> Floats:
        """Unit normal, (2,)."""
        return np.array([-self.along[1], self.along[0]])


def fit_rcm(detected: Sequence[ShaftLine | None], rim: Rim) -> Rcm | None:
    """Fit the point nearest to all lines by iteratively reweighted least squares.

    Lines that hardly turn do not determine its depth; a prior then places it near the middle of the wall.

    Args:
        detected: A line, or None, for every image.
        rim: The globe's wall.

    Returns:
        None if there are too few lines, or they do not meet in the wall.
    """
    lines = [line for line in detected if line is not None]
    if len(lines) < MIN_LINES:
        return None
    normals = np.array([line.normal for line in lines])
    offsets = np.array([normal @ line.point_px for normal, line in zip(normals, lines, strict=True)])
    point = _wall_crossing(lines, rim)
    for _ in range(12):
        relative_sd = _relative_sd(lines, point)
        error = np.abs(normals @ point - offsets) / relative_sd
        weight = 1 / relative_sd / np.maximum(error / max(2 * float(np.median(error)), 0.2), 1)
        point, inverse = _least_squares(normals, offsets, weight, _wall_crossing(lines, rim), rim)
    is_inlier = error < max(5 * float(np.median(error)), 0.5)
    outwards = point - np.array(rim.inner.center_px)
    distance_px = float(np.hypot(*outwards))
    outside_ratio = distance_px / rim.inner.radius_px - 1
    count = is_inlier.sum()
    if count < MIN_LINES or not -MAX_INSIDE_RATIO <= outside_ratio <= MAX_OUTSIDE_RATIO:
        return None
    residual = float(np.sqrt(np.mean((normals[is_inlier] @ point - offsets[is_inlier]) ** 2)))
    outwards /= distance_px
    correlation = math.sqrt(count / min(count, INDEPENDENT_LINES))
    error = np.abs(normals @ point - offsets) / _relative_sd(lines, point)
    line_sd_px = max(1.48 * float(np.median(error[is_inlier])), MIN_LINE_SD_PX)
    radial_sd = line_sd_px * correlation * math.sqrt(float(outwards @ inverse @ outwards))
    if radial_sd > MAX_OUTSIDE_RATIO * rim.inner.radius_px:  # the lines do not meet
        return None
    return Rcm((float(point[0]), float(point[1])), int(count), residual, radial_sd)


def _relative_sd(lines: list[ShaftLine], point: Floats) -> Floats:
    """Return each line's standard deviation at a point, relative to that at its visible middle, (n,)."""
    distance = np.array([abs((point - line.point_px) @ line.along) / line.length_px for line in lines])
    return np.asarray(np.sqrt(1 + 12 * distance**2))


def _wall_crossing(lines: list[ShaftLine], rim: Rim) -> Floats:
    """Return the median point where the lines cross the middle of the wall."""
    center = np.array(rim.inner.center_px)
    middle_px = rim.middle_px
    crossings = []
    for line in lines:
        up = line.along * (-1 if line.along[1] > 0 else 1)
        start = line.point_px - center
        along = float(start @ up)
        half = math.sqrt(max(middle_px**2 - float(start @ start) + along**2, 0))
        crossings.append(line.point_px + (half - along) * up)
    return np.asarray(np.median(crossings, axis=0))


def _least_squares(
    normals: Floats, offsets: Floats, weight: Floats, expected: Floats, rim: Rim
) -> tuple[Floats, Floats]:
    """Return where the lines meet, given a weak prior of its radius, and the inverse normal matrix."""
    outwards = expected - np.array(rim.inner.center_px)
    outwards /= np.hypot(*outwards)
    prior_weight = 1 / (WALL_SD_RATIO * rim.inner.radius_px / 0.3)
    rows = np.vstack([normals * weight[:, None], outwards * prior_weight])
    right = np.append(offsets * weight, outwards @ expected * prior_weight)
    inverse = np.linalg.inv(rows.T @ rows)
    return np.asarray(inverse @ rows.T @ right), np.asarray(inverse)
