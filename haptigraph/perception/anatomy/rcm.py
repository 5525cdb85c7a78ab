"""Where shaft lines meet: the needle's pivot [px].

Turns lines and the wall into one place and how sure it is. Knows no image.
"""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats
from haptigraph.perception.anatomy.rim import Rim

__all__ = ["Rcm", "ShaftLine", "meeting"]

LEAST_LINES = 3
NEAR_WALL = 0.18  # of the globe's radius, that a pivot may lie outside the inner edge
WITHIN_WALL = 0.05  # and inside it
EXPECTED_SD = 0.02  # of the globe's radius: how far from the middle of the visible wall a pivot may well lie
SUREST_PX = 0.06  # no line is known better
INDEPENDENT_LINES = 6  # errors of many images of one clip are alike


class Rcm(Struct, frozen=True, eq=False):
    """Where shaft lines meet."""

    point_px: Vec
    lines: int
    residual_px: float
    """RMS distance of the lines from it."""
    radial_sd_px: float
    """Its standard deviation along the globe's radius; lines that hardly turn leave it open."""

    def and_again(self, other: "Rcm | None") -> "Rcm":
        """Return the mean of two measurements in the same images, each by how sure it is."""
        if other is None:
            return self
        surer = min(self, other, key=lambda rcm: rcm.radial_sd_px)
        one, another = self.radial_sd_px**-2, other.radial_sd_px**-2
        point = (np.array(self.point_px) * one + np.array(other.point_px) * another) / (one + another)
        return replace(surer, point_px=(float(point[0]), float(point[1])))


class ShaftLine(Struct, eq=False):
    """A shaft's middle line in one image."""

    point_px: Floats
    """The middle of what is seen of it, (2,)."""
    along: Floats
    """Its direction, length 1, (2,)."""
    length_px: float
    """How much of it is seen."""

    @property
    def normal(self) -> Floats:
        """Across it, length 1."""
        return np.array([-self.along[1], self.along[0]])


def meeting(seen: Sequence[ShaftLine | None], rim: Rim) -> Rcm | None:
    """Return the place nearest to all lines, by least squares without outliers.

    Where they hardly turn they leave its depth open; then it lies about in the middle of the wall.

    Args:
        seen: A line, or none, for every image.
        rim: Where the wall is.

    Returns:
        The place, or None if lines are few or do not meet in the wall.
    """
    lines = [line for line in seen if line is not None]
    if len(lines) < LEAST_LINES:
        return None
    normals = np.array([line.normal for line in lines])
    offsets = np.array([normal @ line.point_px for normal, line in zip(normals, lines, strict=True)])
    point = _on_the_wall(lines, rim)
    for _ in range(12):
        spread_px = _spreads(lines, point)
        off = np.abs(normals @ point - offsets) / spread_px
        weight = 1 / spread_px / np.maximum(off / max(2 * float(np.median(off)), 0.2), 1)
        point, inverse = _weighted(normals, offsets, weight, _on_the_wall(lines, rim), rim)
    kept = off < max(5 * float(np.median(off)), 0.5)
    outwards = point - np.array(rim.inner.center_px)
    distance_px = float(np.hypot(*outwards))
    beyond = distance_px / rim.inner.radius_px - 1
    if kept.sum() < LEAST_LINES or not -WITHIN_WALL <= beyond <= NEAR_WALL:
        return None
    residual = float(np.sqrt(np.mean((normals[kept] @ point - offsets[kept]) ** 2)))
    outwards /= distance_px
    alike = math.sqrt(kept.sum() / min(kept.sum(), INDEPENDENT_LINES))
    off = np.abs(normals @ point - offsets) / _spreads(lines, point)
    usual_px = max(1.48 * float(np.median(off[kept])), SUREST_PX)
    radial_sd = usual_px * alike * math.sqrt(float(outwards @ inverse @ outwards))
    if radial_sd > NEAR_WALL * rim.inner.radius_px:  # they do not meet
        return None
    return Rcm((float(point[0]), float(point[1])), int(kept.sum()), residual, radial_sd)


def _spreads(lines: list[ShaftLine], point: Floats) -> Floats:
    """Return how much less surely than a shaft seen here each line passes a place, (n,)."""
    away = np.array([abs((point - line.point_px) @ line.along) / line.length_px for line in lines])
    return np.asarray(np.sqrt(1 + 12 * away**2))


def _on_the_wall(lines: list[ShaftLine], rim: Rim) -> Floats:
    """Return where the lines, on the whole, cross the middle of the wall."""
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


def _weighted(
    normals: Floats, offsets: Floats, weight: Floats, expected: Floats, rim: Rim
) -> tuple[Floats, Floats]:
    """Solve for the place where lines meet; one more equation says, weakly, how far out it is."""
    outwards = expected - np.array(rim.inner.center_px)
    outwards /= np.hypot(*outwards)
    loose = 1 / (EXPECTED_SD * rim.inner.radius_px / 0.3)
    rows = np.vstack([normals * weight[:, None], outwards * loose])
    right = np.append(offsets * weight, outwards @ expected * loose)
    inverse = np.linalg.inv(rows.T @ rows)
    return np.asarray(inverse @ rows.T @ right), np.asarray(inverse)
