"""Points and shapes in the eye frame, distances between them, and the mapping between pixels and millimetres.

The eye frame is the plane of the section: origin at the globe's centre, x right, y up as the surgeon
sees the un-mirrored image, millimetres.
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
    "Homography",
    "ImageGeometry",
    "Phase",
    "Point",
    "Polyline",
    "Segment",
    "Vec",
    "angle_between_deg",
    "crosses_polyline",
    "distance_between",
    "distance_to_line",
    "distance_to_polyline",
    "height_on_polyline",
    "nearest_on_polyline",
    "norm",
    "rotate",
    "subtract",
    "unit",
]

Vec: TypeAlias = tuple[float, float]
"""An (x, y) pair; the suffix of the variable gives the unit."""


class Point(Struct, frozen=True, tag="point"):
    """A point."""

    at_mm: Vec


class Segment(Struct, frozen=True, tag="segment"):
    """A line segment, directed from start to end."""

    start_mm: Vec
    end_mm: Vec


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


class Phase(Struct, frozen=True, tag="phase"):
    """An ongoing phase of the operation; it has a duration instead of a position."""

    elapsed_s: float
    """Since its start."""


Geometry: TypeAlias = Point | Segment | Circle | Polyline | Phase


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


class Homography(Struct, frozen=True, dict=True):
    """A projective map between two images of a plane."""

    rows: tuple[tuple[float, float, float], ...]
    """The 3 x 3 matrix for homogeneous (x, y, 1)."""

    def __call__(self, at_px: Vec) -> Vec:
        """Return the position of a point in the other image."""
        x, y, scale = (row[0] * at_px[0] + row[1] * at_px[1] + row[2] for row in self.rows)
        return x / scale, y / scale

    @cached_property
    def matrix(self) -> NDArray[np.float64]:
        """The rows, (3, 3)."""
        return np.array(self.rows, dtype=np.float64)

    @cached_property
    def inverse(self) -> Homography:
        """The inverse map.

        Raises:
            ValueError: If the matrix is singular.
        """
        try:
            back = np.linalg.inv(self.matrix)
        except np.linalg.LinAlgError:
            raise ValueError("a homography that maps a plane to a line has no inverse") from None
        return Homography(tuple(tuple(row) for row in (back / back[2, 2]).tolist()))


class ImageGeometry(Struct, frozen=True):
    """The map between the pixels of an image and the eye frame in millimetres.

    Pixels: the centre of the top-left pixel is (0, 0), x right, y down, in the image as stored. For a tilted
    camera, centre and scale refer to the rectified image.
    """

    center_px: Vec
    """The globe's centre, the origin of the eye frame."""
    mm_per_px: float
    mirrored: bool
    """Whether the image as stored is left-right mirrored (seen through one mirror)."""
    frontal_from_image: Homography | None = None
    """From the image as stored to the view of a camera perpendicular to the section."""
    axial_mm_per_px: float | None = None
    """Vertical scale where it differs from `mm_per_px`: the pixels of a B-scan are not square."""

    def to_mm(self, at_px: Vec) -> Vec:
        """Convert a pixel position to the eye frame [mm]."""
        if self.frontal_from_image is not None:
            at_px = self.frontal_from_image(at_px)
        right = (at_px[0] - self.center_px[0]) * self.mm_per_px
        return -right if self.mirrored else right, (self.center_px[1] - at_px[1]) * self._down_mm_per_px

    def to_px(self, at_mm: Vec) -> Vec:
        """Convert an eye-frame position [mm] to pixels of the image as stored."""
        right = -at_mm[0] if self.mirrored else at_mm[0]
        at_px = (
            self.center_px[0] + right / self.mm_per_px,
            self.center_px[1] - at_mm[1] / self._down_mm_per_px,
        )
        return self.frontal_from_image.inverse(at_px) if self.frontal_from_image else at_px

    @property
    def _down_mm_per_px(self) -> float:
        return self.mm_per_px if self.axial_mm_per_px is None else self.axial_mm_per_px
