"""The measures that relations are decided by: one small function per kind of relation.

Each turns two shapes of an observation into one number, whose unit is the suffix of its name. A new kind of
relation is a new function here and its name in a procedure's TOML. Knows no thresholds.
"""

from collections.abc import Callable, Mapping
from typing import NamedTuple, TypeAlias

from haptigraph.geometry import (
    Circle,
    Geometry,
    Point,
    Polyline,
    Segment,
    angle_between_deg,
    crosses_polyline,
    distance_to_line,
    distance_to_polyline,
    norm,
    subtract,
)

__all__ = ["MEASURES", "Found", "Measure"]

Found: TypeAlias = Mapping[str, Geometry]


class Measure(NamedTuple):
    """A function of (subject, object, all that was found), and the shapes it is made for.

    It returns None where something else that it needs was not found.
    """

    function: Callable[[Geometry, Geometry, Found], float | None]
    shapes: tuple[tuple[str, str], ...]
    """(subject, object) geometries as in the schema."""


def distance_mm(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Distance of a point to a point (Euclidean), or to a surface, signed.

    It is negative where the straight way from the trocar to the point crosses the surface: whatever went
    through stays beyond, however far it is pushed, and so never stops being at most any positive distance.
    """
    trocar = found.get("trocar")
    if isinstance(subject, Point) and isinstance(object, Point):
        return norm(subtract(subject.at_mm, object.at_mm))
    if isinstance(subject, Point) and isinstance(object, Polyline) and isinstance(trocar, Point):
        gap_mm = distance_to_polyline(subject.at_mm, object)
        return -gap_mm if crosses_polyline(trocar.at_mm, subject.at_mm, object) else gap_mm
    return None


def radial_mm(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Distance of a point to the approach axis, the line trocar -> object (the paper's "radial d")."""
    trocar = found.get("trocar")
    if isinstance(subject, Point) and isinstance(object, Point) and isinstance(trocar, Point):
        return distance_to_line(subject.at_mm, trocar.at_mm, object.at_mm)
    return None


def theta_deg(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Angle between a shaft (entry -> tip) and the line trocar -> object."""
    trocar = found.get("trocar")
    if isinstance(subject, Segment) and isinstance(object, Point) and isinstance(trocar, Point):
        shaft = subtract(subject.end_mm, subject.start_mm)
        return angle_between_deg(shaft, subtract(object.at_mm, trocar.at_mm))
    return None


def wall_mm(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Distance of a point to the wall of a circle: positive inside, negative outside."""
    if isinstance(subject, Point) and isinstance(object, Circle):
        return object.radius_mm - norm(subtract(subject.at_mm, object.center_mm))
    return None


MEASURES: dict[str, Measure] = {
    "distance_mm": Measure(distance_mm, (("point", "point"), ("point", "polyline"))),
    "radial_mm": Measure(radial_mm, (("point", "point"),)),
    "theta_deg": Measure(theta_deg, (("segment", "point"),)),
    "wall_mm": Measure(wall_mm, (("point", "circle"),)),
}
"""What a relation's `measure` may name."""
