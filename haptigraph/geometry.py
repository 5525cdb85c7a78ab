"""Points and shapes in the eye frame, and distances between them.

The eye frame is right-handed: origin at the globe's centre, x right, y up as the surgeon sees the un-mirrored
image, z towards the camera, millimetres. Images show its section z = 0; only volumes show more.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

__all__ = [
    "Circle",
    "Geometry",
    "Phase",
    "Point",
    "Polyline",
    "Segment",
    "Surface",
    "Vec",
    "angle_between_deg",
    "crosses_polyline",
    "distance_between",
    "distance_to_line",
    "distance_to_polyline",
    "height_on_polyline",
    "height_on_surface",
    "nearest_on_polyline",
    "norm",
    "rotate",
    "section_of",
    "slope_of_surface",
    "subtract",
    "unit",
]

Vec: TypeAlias = tuple[float, float]
"""An (x, y) pair; the suffix of the variable gives the unit."""


class Point(Struct, frozen=True, tag="point", omit_defaults=True):
    """A point."""

    at_mm: Vec
    z_mm: float = 0.0


class Segment(Struct, frozen=True, tag="segment", omit_defaults=True):
    """A line segment, directed from start to end."""

    start_mm: Vec
    end_mm: Vec
    start_z_mm: float = 0.0
    end_z_mm: float = 0.0

    @property
    def along_mm(self) -> tuple[float, float, float]:
        """The vector (x, y, z) from start to end."""
        right, up = subtract(self.end_mm, self.start_mm)
        return right, up, self.end_z_mm - self.start_z_mm

    @property
    def out_of_plane_deg(self) -> float:
        """Its angle to the section z = 0, positive if it leads towards the camera."""
        right, up, towards = self.along_mm
        return math.degrees(math.atan2(towards, math.hypot(right, up)))


class Circle(Struct, frozen=True, tag="circle"):
    """A full circle."""

    center_mm: Vec
    radius_mm: float


class Polyline(Struct, frozen=True, tag="polyline", dict=True):
    """An open chain of line segments, in order."""

    points_mm: tuple[Vec, ...]

    @cached_property
    def columns_mm(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The x and y coordinates of the points, (n,) each."""
        x, y = np.array(self.points_mm, dtype=np.float64).T
        return np.ascontiguousarray(x), np.ascontiguousarray(y)

    @cached_property
    def steps_mm(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """The x and y extent and the squared length (never 0) of the segments, (n - 1,) each."""
        dx, dy = (np.diff(column) for column in self.columns_mm)
        return dx, dy, np.maximum(dx * dx + dy * dy, 1e-300)


class Surface(Struct, frozen=True, tag="surface", dict=True):
    """A surface in a volume: its height above a grid of positions."""

    x_mm: tuple[float, ...]
    """Columns of the grid, (w,), increasing, at least 2."""
    z_mm: tuple[float, ...]
    """Rows of the grid, (n,), increasing, at least 2."""
    y_mm: tuple[tuple[float, ...], ...]
    """Heights, (n, w)."""
    interpolated: tuple[tuple[int, int], ...] = ()
    """(row, column) of the heights that were not observed."""

    @cached_property
    def grid_mm(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Columns, rows and heights as arrays."""
        return np.array(self.x_mm), np.array(self.z_mm), np.array(self.y_mm, dtype=np.float64)


class Phase(Struct, frozen=True, tag="phase"):
    """An ongoing phase of the operation; it has a duration instead of a position."""

    elapsed_s: float
    """Since its start."""


Geometry: TypeAlias = Point | Segment | Circle | Polyline | Surface | Phase


def subtract(a: Vec, b: Vec) -> Vec:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1]


def norm(v: Vec) -> float:
    """Return the length of v."""
    return math.hypot(v[0], v[1])


def unit(v: Vec) -> Vec:
    """Return v scaled to length 1.

    Raises:
        ValueError: If v has length 0.
    """
    length = norm(v)
    if length == 0.0:
        raise ValueError("a vector of length 0 has no direction")
    return v[0] / length, v[1] / length


def rotate(v: Vec, angle_deg: float) -> Vec:
    """Rotate v counter-clockwise (x towards y)."""
    angle = math.radians(angle_deg)
    c, s = math.cos(angle), math.sin(angle)
    return c * v[0] - s * v[1], s * v[0] + c * v[1]


def _cross(u: Vec, v: Vec) -> float:
    return u[0] * v[1] - u[1] * v[0]


def angle_between_deg(u: Vec, v: Vec) -> float:
    """Return the angle between two directions [deg], 0 to 180; accurate for small angles."""
    dot = u[0] * v[0] + u[1] * v[1]
    return math.degrees(math.atan2(abs(_cross(u, v)), dot))


def distance_to_line(point: Vec, start: Vec, end: Vec) -> float:
    """Return the distance from a point to the infinite line through start and end (which differ)."""
    return abs(_cross(unit(subtract(end, start)), subtract(point, start)))


def distance_to_polyline(point_mm: Vec, line: Polyline) -> float:
    """Return the distance from a point to the nearest point of a polyline [mm]."""
    gap_x, gap_y = _gaps(point_mm, line)
    return math.sqrt((gap_x * gap_x + gap_y * gap_y).min())


def distance_between(one: Segment, other: Segment) -> float:
    """Return the shortest distance between two segments [mm]; 0 if they cross."""
    lines = [Polyline((segment.start_mm, segment.end_mm)) for segment in (one, other)]
    if crosses_polyline(one.start_mm, one.end_mm, lines[1]):
        return 0.0
    return min(
        distance_to_polyline(end, line)
        for segment, line in ((one, lines[1]), (other, lines[0]))
        for end in (segment.start_mm, segment.end_mm)
    )


def nearest_on_polyline(point_mm: Vec, line: Polyline) -> Vec:
    """Return the point of a polyline that is nearest to a given point."""
    gap_x, gap_y = _gaps(point_mm, line)
    best = int((gap_x * gap_x + gap_y * gap_y).argmin())
    return point_mm[0] - float(gap_x[best]), point_mm[1] - float(gap_y[best])


def height_on_polyline(x_mm: float, line: Polyline) -> float:
    """Return the y of a polyline at x [mm]; beyond its ends, that of the nearer end.

    Args:
        x_mm: The position.
        line: A polyline whose x increases or decreases monotonically.
    """
    x, y = line.columns_mm
    return float(np.interp(x_mm, x, y) if x[0] <= x[-1] else np.interp(x_mm, x[::-1], y[::-1]))


def height_on_surface(x_mm: float, z_mm: float, surface: Surface) -> float:
    """Return the y of a surface at (x, z) [mm], bilinear; beyond its borders, that of the nearest border."""
    x, z, y = surface.grid_mm
    column, across = _cell(x_mm, x)
    row, along = _cell(z_mm, z)
    near, far = (y[row + n, column] * (1 - across) + y[row + n, column + 1] * across for n in (0, 1))
    return float(near * (1 - along) + far * along)


def slope_of_surface(x_mm: float, z_mm: float, surface: Surface, reach_mm: float) -> Vec:
    """Return dy/dx and dy/dz of a surface, between points `reach_mm` to either side."""

    def height(right_mm: float, towards_mm: float) -> float:
        return height_on_surface(x_mm + right_mm, z_mm + towards_mm, surface)

    right = height(reach_mm, 0.0) - height(-reach_mm, 0.0)
    towards = height(0.0, reach_mm) - height(0.0, -reach_mm)
    return right / (2 * reach_mm), towards / (2 * reach_mm)


def section_of(surface: Surface, z_mm: float) -> Polyline:
    """Return the section of a surface at z, as the polyline of a B-scan there."""
    return Polyline(tuple((x_mm, height_on_surface(x_mm, z_mm, surface)) for x_mm in surface.x_mm))


def _cell(at: float, grid: NDArray[np.float64]) -> tuple[int, float]:
    """Return the number of the interval of a grid that contains a position, and where in it, 0 to 1."""
    number = min(max(int(np.searchsorted(grid, at)) - 1, 0), len(grid) - 2)
    share = (at - grid[number]) / (grid[number + 1] - grid[number])
    return number, min(max(float(share), 0.0), 1.0)


def _gaps(point_mm: Vec, line: Polyline) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the offsets (x, y) to a point from the nearest point of every segment, (n - 1,) each."""
    (x, y), (dx, dy, squared) = line.columns_mm, line.steps_mm
    from_x, from_y = point_mm[0] - x[:-1], point_mm[1] - y[:-1]
    fraction = np.minimum(np.maximum((from_x * dx + from_y * dy) / squared, 0.0), 1.0)
    return from_x - fraction * dx, from_y - fraction * dy


def crosses_polyline(start_mm: Vec, end_mm: Vec, line: Polyline) -> bool:
    """Return whether the segment from start to end crosses a polyline."""
    x, y = line.columns_mm
    path = subtract(end_mm, start_mm)
    is_left = path[0] * (y - start_mm[1]) > path[1] * (x - start_mm[0])
    for number in (is_left[:-1] != is_left[1:]).nonzero()[0].tolist():  # one or two of a hundred segments
        first, last = line.points_mm[number : number + 2]
        along = subtract(last, first)
        before, after = subtract(start_mm, first), subtract(end_mm, first)
        if _cross(along, before) * _cross(along, after) < 0:
            return True
    return False
