"""Points and shapes in the eye frame, the distances between them, and the way there from pixels.

The eye frame is the plane of the section: origin at the globe's centre, x right, y up as the surgeon
sees the un-mirrored image, millimetres. Knows nothing of needles or retinas.
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
"""An (x, y) pair; the name that holds it says in which unit."""


class Point(Struct, frozen=True, tag="point"):
    """A place."""

    at_mm: Vec


class Segment(Struct, frozen=True, tag="segment"):
    """A straight piece, directed from start to end."""

    start_mm: Vec
    end_mm: Vec


class Circle(Struct, frozen=True, tag="circle"):
    """A full circle."""

    center_mm: Vec
    radius_mm: float


class Polyline(Struct, frozen=True, tag="polyline", dict=True):
    """An open chain of straight pieces, in order."""

    points_mm: tuple[Vec, ...]

    @cached_property
    def columns_mm(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The points' x and y, (n,) each."""
        x, y = np.array(self.points_mm, dtype=np.float64).T
        return np.ascontiguousarray(x), np.ascontiguousarray(y)

    @cached_property
    def steps_mm(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """The pieces' x, y and squared length (never 0), (n - 1,) each."""
        dx, dy = (np.diff(column) for column in self.columns_mm)
        return dx, dy, np.maximum(dx * dx + dy * dy, 1e-300)


class Phase(Struct, frozen=True, tag="phase"):
    """No place but a time: a phase of the operation that goes on."""

    elapsed_s: float
    """Since it began."""


Geometry: TypeAlias = Point | Segment | Circle | Polyline | Phase


def subtract(a: Vec, b: Vec) -> Vec:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1]


def norm(v: Vec) -> float:
    """Return the length of v."""
    return math.hypot(v[0], v[1])


def unit(v: Vec) -> Vec:
    """Return v at length 1.

    Raises:
        ValueError: If v has no length.
    """
    length = norm(v)
    if length == 0.0:
        raise ValueError("a vector of length 0 has no direction")
    return v[0] / length, v[1] / length


def rotate(v: Vec, angle_deg: float) -> Vec:
    """Turn v counter-clockwise (x towards y)."""
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    return c * v[0] - s * v[1], s * v[0] + c * v[1]


def angle_between_deg(u: Vec, v: Vec) -> float:
    """Return the angle between two directions [deg], 0 to 180; exact for small angles."""
    cross = u[0] * v[1] - u[1] * v[0]
    dot = u[0] * v[0] + u[1] * v[1]
    return math.degrees(math.atan2(abs(cross), dot))


def distance_to_line(point: Vec, start: Vec, end: Vec) -> float:
    """Return the distance of a point to the endless line through start and end (which differ)."""
    along = unit(subtract(end, start))
    offset = subtract(point, start)
    return abs(along[0] * offset[1] - along[1] * offset[0])


def distance_to_polyline(point_mm: Vec, line: Polyline) -> float:
    """Return the distance of a point to the nearest place on a polyline [mm]."""
    gap_x, gap_y = _gaps(point_mm, line)
    return math.sqrt((gap_x * gap_x + gap_y * gap_y).min())


def distance_between(one: Segment, other: Segment) -> float:
    """Return the shortest distance between two straight pieces [mm]; 0 where they cross."""
    pieces = [Polyline((piece.start_mm, piece.end_mm)) for piece in (one, other)]
    if crosses_polyline(one.start_mm, one.end_mm, pieces[1]):
        return 0.0
    return min(
        distance_to_polyline(end, piece)
        for ends, piece in ((one, pieces[1]), (other, pieces[0]))
        for end in (ends.start_mm, ends.end_mm)
    )


def nearest_on_polyline(point_mm: Vec, line: Polyline) -> Vec:
    """Return the place on a polyline that is nearest to a point."""
    gap_x, gap_y = _gaps(point_mm, line)
    best = int((gap_x * gap_x + gap_y * gap_y).argmin())
    return point_mm[0] - float(gap_x[best]), point_mm[1] - float(gap_y[best])


def height_on_polyline(x_mm: float, line: Polyline) -> float:
    """Return the y of a chain at some x [mm]; beyond its ends, that of the nearer end.

    Args:
        x_mm: Where.
        line: A chain that goes on to the right, or on to the left.
    """
    x, y = line.columns_mm
    return float(np.interp(x_mm, x, y) if x[0] <= x[-1] else np.interp(x_mm, x[::-1], y[::-1]))


def _gaps(point_mm: Vec, line: Polyline) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the ways (x, y) to a point from the nearest place on every piece, (n - 1,) each."""
    (x, y), (dx, dy, squared) = line.columns_mm, line.steps_mm
    from_x, from_y = point_mm[0] - x[:-1], point_mm[1] - y[:-1]
    share = np.minimum(np.maximum((from_x * dx + from_y * dy) / squared, 0.0), 1.0)
    return from_x - share * dx, from_y - share * dy


def crosses_polyline(start_mm: Vec, end_mm: Vec, line: Polyline) -> bool:
    """Tell whether the straight way from start to end crosses a polyline."""
    (x, y), (dx, dy, _) = line.columns_mm, line.steps_mm
    way = subtract(end_mm, start_mm)
    is_left = way[0] * (y - start_mm[1]) - way[1] * (x - start_mm[0]) > 0

    def side(place: Vec) -> NDArray[np.float64]:
        return dx * (place[1] - y[:-1]) - dy * (place[0] - x[:-1])

    crossed = (is_left[:-1] != is_left[1:]) & (side(start_mm) * side(end_mm) < 0)
    return bool(crossed.any())


class Homography(Struct, frozen=True, dict=True):
    """A map from one picture of a plane to another, such as two cameras take it."""

    rows: tuple[tuple[float, float, float], ...]
    """Three by three, for (x, y, 1); the result is divided by its third part."""

    def __call__(self, at_px: Vec) -> Vec:
        """Return where a place lies in the other picture."""
        x, y, scale = (row[0] * at_px[0] + row[1] * at_px[1] + row[2] for row in self.rows)
        return x / scale, y / scale

    @cached_property
    def matrix(self) -> NDArray[np.float64]:
        """The rows, (3, 3)."""
        return np.array(self.rows, dtype=np.float64)

    @cached_property
    def inverse(self) -> Homography:
        """The map back.

        Raises:
            ValueError: If there is none.
        """
        try:
            back = np.linalg.inv(self.matrix)
        except np.linalg.LinAlgError:
            raise ValueError("a homography that maps a plane to a line has no inverse") from None
        return Homography(tuple(tuple(row) for row in (back / back[2, 2]).tolist()))


class ImageGeometry(Struct, frozen=True):
    """Where the eye frame lies in an image: pixels <-> millimetres.

    Pixels: the centre of the top-left pixel is (0, 0), x right, y down, in the image as stored. Where the
    camera looks at a slant, centre and scale are those of the straightened image.
    """

    center_px: Vec
    """The globe's centre, the origin of the eye frame."""
    mm_per_px: float
    mirrored: bool
    """Whether the image as stored is left-right mirrored (seen through one mirror)."""
    frontal_from_image: Homography | None = None
    """From the image as stored to the one a camera that looks straight at the section would take."""
    axial_mm_per_px: float | None = None
    """Down the image, where that differs from `mm_per_px`: the pixels of a B-scan are not square."""

    def to_mm(self, at_px: Vec) -> Vec:
        """Turn a pixel position into the eye frame [mm]."""
        if self.frontal_from_image is not None:
            at_px = self.frontal_from_image(at_px)
        right = (at_px[0] - self.center_px[0]) * self.mm_per_px
        return -right if self.mirrored else right, (self.center_px[1] - at_px[1]) * self._down_mm_per_px

    def to_px(self, at_mm: Vec) -> Vec:
        """Turn an eye-frame position [mm] into pixels of the image as stored."""
        right = -at_mm[0] if self.mirrored else at_mm[0]
        at_px = (
            self.center_px[0] + right / self.mm_per_px,
            self.center_px[1] - at_mm[1] / self._down_mm_per_px,
        )
        return self.frontal_from_image.inverse(at_px) if self.frontal_from_image else at_px

    @property
    def _down_mm_per_px(self) -> float:
        return self.mm_per_px if self.axial_mm_per_px is None else self.axial_mm_per_px
