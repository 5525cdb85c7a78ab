"""Another target on the registered retina: so far along it from the globe's lowest point.

A registration in, the same with its target moved out; all else stays as registered.
"""

import math
from itertools import pairwise

from msgspec.structs import replace

from haptigraph.errors import BadInput
from haptigraph.geometry import Polyline, Vec
from haptigraph.registration.camera import Registration, anatomy_px, parse_registration
from haptigraph.registration.registered import Registered
from haptigraph.registration.text import registration_text

__all__ = ["along_retina", "angle_rad", "with_target"]


def angle_rad(place_mm: Vec) -> float:
    """Return at which angle about the globe's centre a place lies, eye frame; 0 at the lowest point.

    Positive to the surgeon's right; times the globe's radius it is how far along the retina that is.
    """
    return math.atan2(place_mm[0], -place_mm[1])


def along_retina(retina: Polyline, radius_mm: float, along_mm: float) -> Vec | None:
    """Return a place on the retina [mm], eye frame; None if the retina does not reach so far.

    Args:
        retina: The retina.
        radius_mm: Of the globe, along whose wall it is measured.
        along_mm: From the lowest point, positive to the surgeon's right.
    """
    angle = along_mm / radius_mm
    ends = [angle_rad(place_mm) for place_mm in (retina.points_mm[0], retina.points_mm[-1])]
    if not math.isfinite(angle) or not min(ends) <= angle <= max(ends):
        return None
    far = 2 * radius_mm * math.sin(angle), -2 * radius_mm * math.cos(angle)
    return min(
        (_crossing((0.0, 0.0), far, a, b) for a, b in pairwise(retina.points_mm)), key=lambda hit: hit[0]
    )[1]


def with_target(registration: Registered, along_mm: float) -> Registration:
    """Return a registration with its target elsewhere on the retina.

    Raises:
        BadInput: If the retina does not reach so far, or the target would lie too near the trocar.
    """
    if not isinstance(registration, Registration):
        raise BadInput("source.target_mm is for eyes before a camera; B-scans have target.depth_share")
    place_mm = along_retina(registration.retina, registration.globe.radius_mm, along_mm)
    if place_mm is None:
        raise BadInput(f"source.target_mm: a target at {along_mm:g} mm is beyond the registered retina")
    anatomy = replace(anatomy_px(registration), target_px=registration.image.to_px(place_mm))
    text = registration_text(anatomy, f"Registration with the target moved to {along_mm:+g} mm.")
    return parse_registration(text, f"registration with the target at {along_mm:+g} mm")


def _crossing(start: Vec, end: Vec, a: Vec, b: Vec) -> tuple[float, Vec]:
    """Return how far outside the piece a-b the way from start to end crosses its line, and where."""
    way, piece = (end[0] - start[0], end[1] - start[1]), (b[0] - a[0], b[1] - a[1])
    turn = way[0] * piece[1] - way[1] * piece[0]
    if turn == 0:
        return math.inf, a
    share = ((a[0] - start[0]) * way[1] - (a[1] - start[1]) * way[0]) / turn
    return max(-share, share - 1, 0.0), (a[0] + share * piece[0], a[1] + share * piece[1])
