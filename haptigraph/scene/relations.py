"""The measures that decide relations: one small function per kind of relation.

Each turns two shapes of an observation into one number, whose unit is the suffix of its name. A new kind of
relation is a new function here; procedures refer to it by name and set the thresholds.
"""

from collections.abc import Callable, Mapping
from math import asin, degrees, hypot, inf
from typing import NamedTuple, TypeAlias

from haptigraph.geometry import (
    Circle,
    Geometry,
    Phase,
    Point,
    Polyline,
    Segment,
    Surface,
    angle_between_deg,
    crosses_polyline,
    distance_between,
    distance_to_line,
    distance_to_polyline,
    height_on_polyline,
    height_on_surface,
    norm,
    slope_of_surface,
    subtract,
)
from haptigraph.messages import Certainty
from haptigraph.scene.in_space import out_of_plane_deg, out_of_plane_mm, theta_space_deg

__all__ = ["MEASURES", "SMALLEST_EYE_MM", "Found", "Limits", "Measure", "Plausible"]

UM_PER_MM = 1000.0
SLOPE_MM = 0.1  # the slope of a surface is taken between points this far to either side

Found: TypeAlias = Mapping[str, Geometry]


class Limits(NamedTuple):
    """Geometric limits of a measure that hold in every scene; `haptigraph check` uses them in proofs."""

    lower: float = -inf
    upper: float = inf
    """Both in the measure's unit."""
    requires: tuple[str, ...] = ()
    """Entities that must be detected besides subject and object."""
    never_above: str = ""
    """A measure of the same subject and object that this one never exceeds."""


class Plausible(NamedTuple):
    """The thresholds of a measure that make sense; 0 always does."""

    low: float
    high: float
    """In its unit; a threshold is between them."""
    resolution: float
    """In its unit; a smaller threshold cannot be measured."""
    because: str
    """Why, as a clause: "the smallest eye that can be registered is 15 mm wide"."""


SMALLEST_EYE_MM = 15.0
"""Inner diameter; registration accepts no smaller globe."""
_EYE = f"the smallest eye that can be registered is {SMALLEST_EYE_MM:g} mm wide"
_ACROSS_MM = Plausible(-SMALLEST_EYE_MM, SMALLEST_EYE_MM, 0.01, _EYE)
_BETWEEN_MM = Plausible(0.0, SMALLEST_EYE_MM, 0.01, _EYE)
_WALL_MM = Plausible(-SMALLEST_EYE_MM / 4, SMALLEST_EYE_MM / 4, 0.01, _EYE)
_BSCAN_UM = Plausible(-6000.0, 6000.0, 1.0, "B-scans of the retina are at most 6 mm deep")
_BESIDE_UM = Plausible(0.0, 6000.0, 1.0, "volumes of the retina are at most 12 mm wide")
_ANGLE_DEG = Plausible(0.0, 90.0, 0.1, "a shaft that enters the eye deviates by less than a right angle")
_INCIDENCE_DEG = Plausible(0.0, 90.0, 0.1, "no shaft is steeper than perpendicular")
_DEPTH_PERCENT = Plausible(-1000.0, 1000.0, 0.1, "B-scans show at most ten times the retina")
_PHASE_S = Plausible(0.0, 86_400.0, 0.01, "no phase of an operation lasts a day")


class Measure(NamedTuple):
    """A function of (subject, object, all detected entities), and the shapes that it supports.

    The function returns None if another entity that it requires was not detected.
    """

    function: Callable[[Geometry, Geometry, Found], float | None]
    shapes: Mapping[tuple[str, str], Limits]
    """By (subject, object) geometries as in the schema."""
    plausible: Plausible
    """The thresholds that make sense."""
    sd: Callable[[Certainty], float | None] | None = None
    """Its standard deviation due to the subject's; None if there is none. No measure changes by more than the
    subject does, so a distance has the standard deviation of the tip, the angle that of the shaft."""


def distance_mm(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Euclidean distance between two points, or signed distance from a point or polyline to a surface.

    Of a polyline the nearest vertex counts. The distance is negative if the segment from the trocar to the
    point crosses the surface: a tip that went through the surface stays below any positive threshold, however
    far it is pushed.
    """
    trocar = found.get("trocar")
    if isinstance(subject, Point) and isinstance(object, Point):
        apart_mm, depth_mm = norm(subtract(subject.at_mm, object.at_mm)), subject.z_mm - object.z_mm
        return hypot(apart_mm, depth_mm) if depth_mm else apart_mm
    if isinstance(subject, Polyline):
        gaps_mm = [distance_mm(Point(vertex), object, found) for vertex in subject.points_mm]
        return min((gap_mm for gap_mm in gaps_mm if gap_mm is not None), default=None)
    if isinstance(subject, Point) and isinstance(object, Polyline) and isinstance(trocar, Point):
        gap_mm = distance_to_polyline(subject.at_mm, object)
        return -gap_mm if crosses_polyline(trocar.at_mm, subject.at_mm, object) else gap_mm
    return None


def tip_disagreement_mm(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Distance between two observations of one tip: in the section, or in 3D if the first has a z."""
    if isinstance(subject, Point) and isinstance(object, Point):
        apart_mm = norm(subtract(subject.at_mm, object.at_mm))
        return hypot(apart_mm, subject.z_mm - object.z_mm) if subject.z_mm else apart_mm
    return None


def radial_mm(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Distance from a point to the approach axis, the line trocar -> object (the paper's "radial d")."""
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
    """Distance from a point to the wall of a circle: positive inside, negative outside."""
    if isinstance(subject, Point) and isinstance(object, Circle):
        return object.radius_mm - norm(subtract(subject.at_mm, object.center_mm))
    return None


def clearance_mm(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Shortest distance between the centre lines of two shafts; 0 if they cross in the image."""
    if isinstance(subject, Segment) and isinstance(object, Segment):
        return distance_between(subject, object)
    return None


def aside_mm(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Lateral distance from a point to a region of the retina, seen from the globe's centre; <= 0 above it.

    The distance to the segment from the globe's centre to the region's, minus the region's radius.
    """
    globe = found.get("eye_globe")
    if isinstance(subject, Point) and isinstance(object, Circle) and isinstance(globe, Circle):
        axis = Polyline((globe.center_mm, object.center_mm))
        return distance_to_polyline(subject.at_mm, axis) - object.radius_mm
    return None


def gap_um(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Distance from a point to a surface in OCT: positive above it, against the beam, negative below.

    In a volume it is measured along the normal of the surface below the point.
    """
    if isinstance(subject, Point) and isinstance(object, Surface):
        x, y = subject.at_mm
        slopes = slope_of_surface(x, subject.z_mm, object, SLOPE_MM)
        return UM_PER_MM * (y - height_on_surface(x, subject.z_mm, object)) / hypot(1.0, *slopes)
    if isinstance(subject, Point) and isinstance(object, Polyline):
        gap_um = UM_PER_MM * distance_to_polyline(subject.at_mm, object)
        return gap_um if subject.at_mm[1] >= height_on_polyline(subject.at_mm[0], object) else -gap_um
    return None


def incidence_deg(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Angle between a shaft and the surface below its tip: 0 parallel, 90 perpendicular."""
    if isinstance(subject, Segment) and isinstance(object, Surface):
        right, up, towards = subject.along_mm
        slopes = slope_of_surface(subject.end_mm[0], subject.end_z_mm, object, SLOPE_MM)
        along_normal = (up - slopes[0] * right - slopes[1] * towards) / hypot(1.0, *slopes)
        return degrees(asin(min(abs(along_normal) / hypot(right, up, towards), 1.0)))
    if isinstance(subject, Segment) and isinstance(object, Polyline):
        shaft, x = subtract(subject.end_mm, subject.start_mm), subject.end_mm[0]
        left, right = (x - SLOPE_MM, x + SLOPE_MM)
        along = right - left, height_on_polyline(right, object) - height_on_polyline(left, object)
        angle_deg = angle_between_deg(shaft, along)
        return min(angle_deg, 180 - angle_deg)
    return None


def depth_percent(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Position of a point along the beam between a surface (0) and the RPE (100)."""
    rpe = found.get("rpe")
    if isinstance(subject, Point) and rpe is not None:
        top_mm, bottom_mm = _height_mm(object, subject), _height_mm(rpe, subject)
        if top_mm is not None and bottom_mm is not None and top_mm > bottom_mm:
            return 100 * (top_mm - subject.at_mm[1]) / (top_mm - bottom_mm)
    return None


def thickness_um(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Distance along the beam between two surfaces, in the column of the needle tip."""
    tip = found.get("needle_tip")
    if not isinstance(tip, Point):
        return None
    top_mm, bottom_mm = _height_mm(subject, tip), _height_mm(object, tip)
    return None if top_mm is None or bottom_mm is None else UM_PER_MM * (top_mm - bottom_mm)


def out_of_plane_um(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Distance of a point from the section z = 0, on either side: a single B-scan does not show it."""
    return (
        UM_PER_MM * abs(subject.z_mm) if isinstance(subject, Point) and isinstance(object, Surface) else None
    )


def _height_mm(surface: Geometry, point: Point) -> float | None:
    """Return the height of a surface below or above a point; None of any other shape."""
    if isinstance(surface, Surface):
        return height_on_surface(point.at_mm[0], point.z_mm, surface)
    return height_on_polyline(point.at_mm[0], surface) if isinstance(surface, Polyline) else None


def elapsed_s(subject: Geometry, object: Geometry, found: Found) -> float | None:
    """Time since the start of a phase; every detected entity is within it."""
    return object.elapsed_s if isinstance(object, Phase) else None


def _tip_sd_mm(certainty: Certainty) -> float | None:
    return certainty.tip_sd_mm


def _tip_sd_um(certainty: Certainty) -> float | None:
    return None if certainty.tip_sd_mm is None else UM_PER_MM * certainty.tip_sd_mm


def _theta_sd_deg(certainty: Certainty) -> float | None:
    return certainty.theta_sd_deg


def _out_of_plane_sd_deg(certainty: Certainty) -> float | None:
    return certainty.out_of_plane_sd_deg


def _theta_space_sd_deg(certainty: Certainty) -> float | None:
    """Return the larger one: an angle in space changes by no more than the shaft turns."""
    out_of_plane = certainty.out_of_plane_sd_deg
    return None if out_of_plane is None else max(certainty.theta_sd_deg, out_of_plane)


MEASURES: dict[str, Measure] = {
    "distance_mm": Measure(
        distance_mm,
        {
            ("point", "point"): Limits(lower=0.0),
            ("point", "polyline"): Limits(requires=("trocar",)),
            ("polyline", "polyline"): Limits(requires=("trocar",)),
        },
        _ACROSS_MM,
        _tip_sd_mm,
    ),
    "radial_mm": Measure(
        radial_mm,  # the axis passes through the object, so it is never further away than the object
        {("point", "point"): Limits(lower=0.0, requires=("trocar",), never_above="distance_mm")},
        _BETWEEN_MM,
        _tip_sd_mm,
    ),
    "tip_disagreement_mm": Measure(
        tip_disagreement_mm, {("point", "point"): Limits(lower=0.0)}, _BETWEEN_MM, _tip_sd_mm
    ),
    "theta_deg": Measure(
        theta_deg,
        {("segment", "point"): Limits(0.0, 180.0, requires=("trocar",))},
        _ANGLE_DEG,
        _theta_sd_deg,
    ),
    "wall_mm": Measure(wall_mm, {("point", "circle"): Limits()}, _WALL_MM, _tip_sd_mm),
    "clearance_mm": Measure(clearance_mm, {("segment", "segment"): Limits(lower=0.0)}, _BETWEEN_MM),
    "aside_mm": Measure(
        aside_mm, {("point", "circle"): Limits(requires=("eye_globe",))}, _ACROSS_MM, _tip_sd_mm
    ),
    "gap_um": Measure(
        gap_um, {("point", "polyline"): Limits(), ("point", "surface"): Limits()}, _BSCAN_UM, _tip_sd_um
    ),
    "incidence_deg": Measure(
        incidence_deg,
        {("segment", "polyline"): Limits(0.0, 90.0), ("segment", "surface"): Limits(0.0, 90.0)},
        _INCIDENCE_DEG,
    ),
    "depth_percent": Measure(
        depth_percent,
        {
            ("point", "polyline"): Limits(requires=("rpe",)),
            ("point", "surface"): Limits(requires=("rpe",)),
        },
        _DEPTH_PERCENT,
    ),
    "thickness_um": Measure(
        thickness_um,
        {
            ("polyline", "polyline"): Limits(requires=("needle_tip",)),
            ("surface", "surface"): Limits(requires=("needle_tip",)),
        },
        _BSCAN_UM,
    ),
    "out_of_plane_um": Measure(
        out_of_plane_um, {("point", "surface"): Limits(lower=0.0)}, _BESIDE_UM, _tip_sd_um
    ),
    "out_of_plane_mm": Measure(
        out_of_plane_mm, {("segment", "circle"): Limits(lower=0.0)}, _BETWEEN_MM, _tip_sd_mm
    ),
    "out_of_plane_deg": Measure(
        out_of_plane_deg, {("segment", "circle"): Limits(0.0, 90.0)}, _ANGLE_DEG, _out_of_plane_sd_deg
    ),
    "theta_space_deg": Measure(
        theta_space_deg,
        {("segment", "point"): Limits(0.0, 180.0, requires=("trocar",))},
        _ANGLE_DEG,
        _theta_space_sd_deg,
    ),
    "elapsed_s": Measure(elapsed_s, {("point", "phase"): Limits(lower=0.0)}, _PHASE_S),
}
"""The valid values of a relation's `measure`."""
