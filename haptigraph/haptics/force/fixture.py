"""Place force fields in the eye, map them to the hand, and compute their force. Pure functions.

Each fixture is the gradient of a convex potential, with damping, so that in continuous time it is passive
(virtual fixtures: Rosenberg 1993; forbidden regions: Abbott, Marayong, Okamura 2007).
"""

import math
from typing import Literal, TypeAlias

from msgspec import Struct
from msgspec.structs import replace

from haptigraph.geometry import (
    Geometry,
    Point,
    Polyline,
    Surface,
    crosses_polyline,
    height_on_polyline,
    height_on_surface,
    nearest_on_polyline,
    slope_of_surface,
)
from haptigraph.grammar import ForceField
from haptigraph.messages import Step
from haptigraph.robot.pose import Vec3

__all__ = ["Fixture", "elastic_mj", "fixtures_of", "force_n", "tip_of", "to_hand"]

SLOPE_MM = 0.1  # the slope of a surface is taken between points this far to either side

Placed: TypeAlias = tuple[Vec3, Vec3]
"""A point and a direction."""


class Fixture(Struct, frozen=True):
    """A force field at a position: in the eye frame, or after `to_hand` in the frame of the hand."""

    kind: Literal["cone", "plane", "viscous"]
    point_mm: Vec3 = (0.0, 0.0, 0.0)
    """Apex of a cone, a point of a plane."""
    direction: Vec3 = (0.0, 0.0, 1.0)
    """Axis of a cone, normal of a plane towards the permitted side; length 1."""
    half_angle_deg: float = 0.0
    """Of a cone."""
    stiffness_n_per_mm: float = 0.0
    """At the hand."""
    damping_n_s_per_mm: float = 0.0
    """At the hand."""
    limit_n: float = 1.0
    is_planar: bool = False
    """Whether it acts in x and y only, because the image shows one section."""


def fixtures_of(step: Step) -> tuple[Fixture, ...]:
    """Return the fixtures of one step in the eye frame; none whose geometry was not observed."""
    found = step.observation.found
    tip = found.get("needle_tip")
    if not isinstance(tip, Point):
        return ()
    is_planar = not any(isinstance(shape, Surface) for shape in found.values())
    fixtures = []
    for field in step.command.forces:
        placed = _placed(field, tip, found)
        if placed is not None:
            point_mm, direction = placed
            fixtures.append(
                Fixture(
                    field.kind,
                    point_mm,
                    direction,
                    field.half_angle_deg,
                    field.stiffness_n_per_mm,
                    field.damping_n_s_per_mm,
                    field.limit_n,
                    is_planar,
                )
            )
    return tuple(fixtures)


def tip_of(step: Step) -> Vec3 | None:
    """Return the tip of one step [mm], eye frame; None if it was not observed."""
    tip = step.observation.found.get("needle_tip")
    return _vec3(tip) if isinstance(tip, Point) else None


def to_hand(fixture: Fixture, tip_mm: Vec3, hand_mm: Vec3, scale: float) -> Fixture:
    """Map a fixture from the eye frame to the frame of the hand; their axes are parallel.

    Args:
        fixture: In the eye frame.
        tip_mm: The tip, eye frame.
        hand_mm: The hand when the image was taken; the same position as `tip_mm`.
        scale: Ratio of tip motion to hand motion.
    """
    x, y, z = (
        hand + (point - tip) / scale
        for point, tip, hand in zip(fixture.point_mm, tip_mm, hand_mm, strict=True)
    )
    return replace(fixture, point_mm=(x, y, z))


def force_n(fixture: Fixture, position_mm: Vec3, velocity_mm_s: Vec3) -> Vec3:
    """Return the force on a hand at a position [N], in the frame of the fixture."""
    if fixture.is_planar:
        position_mm = *position_mm[:2], fixture.point_mm[2]
        velocity_mm_s = *velocity_mm_s[:2], 0.0
    if fixture.kind == "viscous":
        speed_mm_s = math.hypot(*velocity_mm_s)
        size_n = min(fixture.damping_n_s_per_mm * speed_mm_s, fixture.limit_n)
        return _scaled(velocity_mm_s, -size_n / speed_mm_s if speed_mm_s else 0.0)
    depth_mm, inwards = _penetration(fixture, position_mm)
    if depth_mm <= 0:
        return 0.0, 0.0, 0.0
    size_n = fixture.stiffness_n_per_mm * depth_mm
    size_n -= fixture.damping_n_s_per_mm * _dot(velocity_mm_s, inwards)
    x, y, z = _scaled(inwards, min(max(size_n, 0.0), fixture.limit_n))  # a wall never holds the hand back
    return x, y, 0.0 if fixture.is_planar else z


def elastic_mj(fixture: Fixture, position_mm: Vec3) -> float:
    """Return the energy that the hand has stored in a fixture, which it may get back [mJ]."""
    if fixture.kind == "viscous":
        return 0.0
    if fixture.is_planar:
        position_mm = *position_mm[:2], fixture.point_mm[2]
    force = fixture.stiffness_n_per_mm * max(_penetration(fixture, position_mm)[0], 0.0)
    springy = min(force, fixture.limit_n)
    return springy * (force - springy / 2) / fixture.stiffness_n_per_mm if force else 0.0


def _penetration(fixture: Fixture, position_mm: Vec3) -> tuple[float, Vec3]:
    """Return the distance to the permitted side [mm], negative or 0 on it, and the direction there."""
    x, y, z = (at - point for at, point in zip(position_mm, fixture.point_mm, strict=True))
    along_mm = _dot((x, y, z), fixture.direction)
    if fixture.kind == "plane":
        return -along_mm, fixture.direction
    across = _added((x, y, z), _scaled(fixture.direction, -along_mm))
    across_mm = math.hypot(*across)
    cos, sin = _cos_sin(fixture.half_angle_deg)
    if along_mm * cos + across_mm * sin <= 0:  # behind the apex
        distance_mm = math.hypot(x, y, z)
        return distance_mm, _scaled((x, y, z), -1 / distance_mm) if distance_mm else fixture.direction
    depth_mm = across_mm * cos - along_mm * sin
    if depth_mm <= 0:
        return depth_mm, fixture.direction
    return depth_mm, _added(_scaled(across, -cos / across_mm), _scaled(fixture.direction, sin))


def _cos_sin(angle_deg: float) -> tuple[float, float]:
    angle_rad = math.radians(angle_deg)
    return math.cos(angle_rad), math.sin(angle_rad)


def _placed(field: ForceField, tip: Point, found: dict[str, Geometry]) -> Placed | None:
    """Return point and direction of a force field in the eye; None if what it needs was not observed."""
    if field.kind == "viscous":
        return _vec3(tip), (0.0, 0.0, 1.0)
    if field.kind == "cone":
        return _axis(found)
    return _above_retina(field.height_mm, tip, found)


def _axis(found: dict[str, Geometry]) -> Placed | None:
    """Return the trocar and the direction to the target."""
    trocar, target = found.get("trocar"), found.get("retina_target")
    if not (isinstance(trocar, Point) and isinstance(target, Point)):
        return None
    apex, end = _vec3(trocar), _vec3(target)
    direction = _unit(_added(end, _scaled(apex, -1.0)))
    return None if direction is None else (apex, direction)


def _above_retina(height_mm: float, tip: Point, found: dict[str, Geometry]) -> Placed | None:
    """Return a point at a height above the retina below the tip, and the normal towards the vitreous."""
    retina, (x, y) = found.get("retina_surface"), tip.at_mm
    if isinstance(retina, Surface):
        surface_mm = x, height_on_surface(x, tip.z_mm, retina), tip.z_mm
        slopes = slope_of_surface(x, tip.z_mm, retina, SLOPE_MM)
        normal = _unit((-slopes[0], 1.0, -slopes[1]))
    elif isinstance(retina, Polyline):
        nearest = nearest_on_polyline(tip.at_mm, retina)
        side = 1.0 if _is_in_vitreous(tip, retina, found) else -1.0
        surface_mm = (*nearest, 0.0)
        normal = _unit((side * (x - nearest[0]), side * (y - nearest[1]), 0.0)) or _towards(nearest, found)
    else:
        return None
    return None if normal is None else (_added(surface_mm, _scaled(normal, height_mm)), normal)


def _is_in_vitreous(tip: Point, retina: Polyline, found: dict[str, Geometry]) -> bool:
    """Return whether the tip is on the trocar's side of the retina; in OCT, without a trocar, above it."""
    trocar = found.get("trocar")
    if isinstance(trocar, Point):
        return not crosses_polyline(trocar.at_mm, tip.at_mm, retina)
    return tip.at_mm[1] >= height_on_polyline(tip.at_mm[0], retina)


def _towards(nearest: tuple[float, float], found: dict[str, Geometry]) -> Vec3 | None:
    """Return the direction to the vitreous of a tip that lies exactly on the retina."""
    trocar = found.get("trocar")
    if not isinstance(trocar, Point):
        return 0.0, 1.0, 0.0
    return _unit((trocar.at_mm[0] - nearest[0], trocar.at_mm[1] - nearest[1], 0.0))


def _vec3(point: Point) -> Vec3:
    return (*point.at_mm, point.z_mm)


def _dot(a: Vec3, b: Vec3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _added(a: Vec3, b: Vec3) -> Vec3:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _scaled(a: Vec3, factor: float) -> Vec3:
    return a[0] * factor, a[1] * factor, a[2] * factor


def _unit(a: Vec3) -> Vec3 | None:
    length = math.hypot(*a)
    return _scaled(a, 1 / length) if length > 1e-9 else None
