"""Move the target of a registration along the retina; all else stays as registered."""

import math
from itertools import pairwise

from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.geometry import Polyline, Vec
from haptigraph.registration.assumed import TARGET
from haptigraph.registration.camera import Registration, anatomy_px, camera_registration
from haptigraph.registration.registered import BaseRegistration
from haptigraph.registration.text import registration_text
from haptigraph.toml_document import Document

__all__ = ["point_on_retina", "retina_angle_rad", "with_target"]


def retina_angle_rad(point_mm: Vec) -> float:
    """Return the angle of a point about the globe's centre, eye frame; 0 at the lowest point.

    Positive to the surgeon's right; times the globe's radius it is the arc length along the retina.
    """
    return math.atan2(point_mm[0], -point_mm[1])


def point_on_retina(retina: Polyline, radius_mm: float, along_mm: float) -> Vec | None:
    """Return the point at an arc length along the retina [mm], eye frame; None if it is beyond the ends.

    Args:
        retina: The retina.
        radius_mm: Radius of the globe, along whose wall the arc is measured.
        along_mm: Arc length from the lowest point, positive to the surgeon's right.
    """
    angle = along_mm / radius_mm
    ends = [retina_angle_rad(point_mm) for point_mm in (retina.points_mm[0], retina.points_mm[-1])]
    if not math.isfinite(angle) or not min(ends) <= angle <= max(ends):
        return None
    far = 2 * radius_mm * math.sin(angle), -2 * radius_mm * math.cos(angle)
    return min(
        (_crossing((0.0, 0.0), far, a, b) for a, b in pairwise(retina.points_mm)), key=lambda hit: hit[0]
    )[1]


def with_target(registration: BaseRegistration, along_mm: float) -> Registration:
    """Return a registration with its target moved along the retina.

    Raises:
        BadInput: If the target would be beyond the retina's ends or too near the trocar.
    """
    if not isinstance(registration, Registration):
        raise BadInput("source.target_mm is for eyes before a camera; B-scans have target.depth_share")
    point_mm = point_on_retina(registration.retina, registration.globe.radius_mm, along_mm)
    if point_mm is None:
        raise BadInput(f"source.target_mm: a target at {along_mm:g} mm is beyond the registered retina")
    assumed = tuple(name for name in registration.assumed if name != TARGET)
    target_px = registration.image.to_px(point_mm)
    anatomy = replace(anatomy_px(registration), target_px=target_px, assumed=assumed)
    text = registration_text(anatomy, f"Registration with the target moved to {along_mm:+g} mm.")
    return camera_registration(Document(text, f"registration with the target at {along_mm:+g} mm"))


def _crossing(start: Vec, end: Vec, a: Vec, b: Vec) -> tuple[float, Vec]:
    """Intersect lines start-end and a-b; return how far outside segment a-b (share of it), and the point."""
    ray, segment = (end[0] - start[0], end[1] - start[1]), (b[0] - a[0], b[1] - a[1])
    cross = ray[0] * segment[1] - ray[1] * segment[0]
    if cross == 0:
        return math.inf, a
    share = ((a[0] - start[0]) * ray[1] - (a[1] - start[1]) * ray[0]) / cross
    return max(-share, share - 1, 0.0), (a[0] + share * segment[0], a[1] + share * segment[1])
