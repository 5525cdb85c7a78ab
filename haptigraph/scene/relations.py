"""The measures that relations are decided by: one small function per kind of relation.

Each turns two shapes of an observation into one number, whose unit is the suffix of its name. A new kind of
relation is a new function here and its name in a procedure's TOML. Knows no thresholds.
"""

from collections.abc import Callable, Mapping
from math import inf
from typing import NamedTuple, TypeAlias

from haptigraph.geometry import (
    Circle,
    Geometry,
    Phase,
    Point,
    Polyline,
    Segment,
    angle_between_deg,
    crosses_polyline,
    distance_between,
    distance_to_line,
    distance_to_polyline,
    height_on_polyline,
    norm,
    subtract,
)

__all__ = ["MEASURES", "Always", "Found", "Measure"]

UM_PER_MM = 1000.0
BESIDE_MM = 0.1  # a surface's slope is taken so far to either side

Found: TypeAlias = Mapping[str, Geometry]


class Always(NamedTuple):
    """What geometry says of a measure whatever the scene; `haptigraph check` proves with it."""

    least: float = -inf
    most: float = inf
    """Both in the measure's unit."""
    needs: tuple[str, ...] = ()
    """Entities that must be found besides subject and object."""
    never_above: str = ""
    """A measure of the same subject and object that this one never exceeds."""


class Measure(NamedTuple):
    """A function of (subject, object, all that was found), and the shapes it is made for.

    It returns None where something else that it needs was not found.
    """

    function: Callable[[Geometry, Geometry, Found], float | None]
    shapes: Mapping[tuple[str, str], Always]
    """By (subject, object) geometries as in the schema."""


def distance_mm(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Distance of a point to a point (Euclidean), or of a point or a chain of them to a surface, signed.

    Of a chain the nearest point counts. It is negative where the straight way from the trocar to the point
    crosses the surface: whatever went through stays beyond, however far it is pushed, and so never stops
    being at most any positive distance.
    """
    trocar = found.get("trocar")
    if isinstance(subject, Point) and isinstance(object, Point):
        return norm(subtract(subject.at_mm, object.at_mm))
    if isinstance(subject, Polyline):
        gaps_mm = [distance_mm(Point(place), object, found) for place in subject.points_mm]
        return min((gap_mm for gap_mm in gaps_mm if gap_mm is not None), default=None)
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


def clearance_mm(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Shortest distance between the middle lines of two shafts; 0 where they cross in the picture."""
    if isinstance(subject, Segment) and isinstance(object, Segment):
        return distance_between(subject, object)
    return None


def aside_mm(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """How far beside a region of the retina a point is, seen from the globe's centre; at most 0 over it.

    The distance to the way from the centre to the region's middle, less the region's radius.
    """
    globe = found.get("eye_globe")
    if isinstance(subject, Point) and isinstance(object, Circle) and isinstance(globe, Circle):
        way = Polyline((globe.center_mm, object.center_mm))
        return distance_to_polyline(subject.at_mm, way) - object.radius_mm
    return None


def gap_um(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Distance of a point to a surface of a B-scan: positive above it, against the beam, negative below."""
    if isinstance(subject, Point) and isinstance(object, Polyline):
        gap_um = UM_PER_MM * distance_to_polyline(subject.at_mm, object)
        return gap_um if subject.at_mm[1] >= height_on_polyline(subject.at_mm[0], object) else -gap_um
    return None


def incidence_deg(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Angle between a shaft and a surface below its tip: 0 along it, 90 straight into it."""
    if isinstance(subject, Segment) and isinstance(object, Polyline):
        shaft, x = subtract(subject.end_mm, subject.start_mm), subject.end_mm[0]
        left, right = (x - BESIDE_MM, x + BESIDE_MM)
        along = right - left, height_on_polyline(right, object) - height_on_polyline(left, object)
        angle_deg = angle_between_deg(shaft, along)
        return min(angle_deg, 180 - angle_deg)
    return None


def depth_percent(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """How far a point is on the way from a surface (0) down the beam to the RPE (100)."""
    rpe = found.get("rpe")
    if isinstance(subject, Point) and isinstance(object, Polyline) and isinstance(rpe, Polyline):
        x, y = subject.at_mm
        top, bottom = height_on_polyline(x, object), height_on_polyline(x, rpe)
        return 100 * (top - y) / (top - bottom) if top > bottom else None
    return None


def thickness_um(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """From one surface down the beam to another, in the column of the needle's tip."""
    tip = found.get("needle_tip")
    if isinstance(subject, Polyline) and isinstance(object, Polyline) and isinstance(tip, Point):
        top, bottom = (height_on_polyline(tip.at_mm[0], surface) for surface in (subject, object))
        return UM_PER_MM * (top - bottom)
    return None


def elapsed_s(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """How long a phase has been going on; whatever is found is found during it."""
    return object.elapsed_s if isinstance(object, Phase) else None


MEASURES: dict[str, Measure] = {
    "distance_mm": Measure(
        distance_mm,
        {
            ("point", "point"): Always(least=0.0),
            ("point", "polyline"): Always(needs=("trocar",)),
            ("polyline", "polyline"): Always(needs=("trocar",)),
        },
    ),
    "radial_mm": Measure(
        radial_mm,  # the line leads through the object, so it is never further away than the object
        {("point", "point"): Always(least=0.0, needs=("trocar",), never_above="distance_mm")},
    ),
    "theta_deg": Measure(theta_deg, {("segment", "point"): Always(0.0, 180.0, needs=("trocar",))}),
    "wall_mm": Measure(wall_mm, {("point", "circle"): Always()}),
    "clearance_mm": Measure(clearance_mm, {("segment", "segment"): Always(least=0.0)}),
    "aside_mm": Measure(aside_mm, {("point", "circle"): Always(needs=("eye_globe",))}),
    "gap_um": Measure(gap_um, {("point", "polyline"): Always()}),
    "incidence_deg": Measure(incidence_deg, {("segment", "polyline"): Always(0.0, 90.0)}),
    "depth_percent": Measure(depth_percent, {("point", "polyline"): Always(needs=("rpe",))}),
    "thickness_um": Measure(thickness_um, {("polyline", "polyline"): Always(needs=("needle_tip",))}),
    "elapsed_s": Measure(elapsed_s, {("point", "phase"): Always(least=0.0)}),
}
"""What a relation's `measure` may name."""
