"""The measures of a shaft in space, which depth shows and a single image does not."""

from collections.abc import Mapping
from math import atan2, degrees, hypot

from haptigraph.geometry import Circle, Geometry, Point, Segment, subtract

__all__ = ["out_of_plane_deg", "out_of_plane_mm", "theta_space_deg"]


def out_of_plane_mm(subject: Geometry, object: Geometry, found: Mapping[str, Geometry]) -> float | None:
    """Distance of a shaft's tip from the section z = 0 of the globe, on either side."""
    return abs(subject.end_z_mm) if isinstance(subject, Segment) and isinstance(object, Circle) else None


def out_of_plane_deg(subject: Geometry, object: Geometry, found: Mapping[str, Geometry]) -> float | None:
    """Angle between a shaft and the section of the globe, towards either side."""
    if isinstance(subject, Segment) and isinstance(object, Circle):
        return abs(subject.out_of_plane_deg)
    return None


def theta_space_deg(subject: Geometry, object: Geometry, found: Mapping[str, Geometry]) -> float | None:
    """Angle in space between a shaft and the line trocar -> object; `theta_deg` is that in the image."""
    trocar = found.get("trocar")
    if not (isinstance(subject, Segment) and isinstance(object, Point) and isinstance(trocar, Point)):
        return None
    (right, up, towards), (x, y) = subject.along_mm, subtract(object.at_mm, trocar.at_mm)
    across = hypot(towards * x, towards * y, right * y - up * x)
    return degrees(atan2(across, right * x + up * y))
