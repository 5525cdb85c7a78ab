"""The mirror's mount: a plate at 45 degrees with a slot for a front-surface mirror, between two walls."""

from build123d import Part, Plane

from rig.feet import feet_of, mirror_wall_mm
from rig.layout import FLOOR_MM, Layout
from rig.shapes import prism, rod, slab
from rig.standard import INSERT_DEPTH_MM, INSERT_MM, SLIDE_MM, Print

__all__ = ["LIP_MM", "PRINT", "build", "mirror", "mirror_plane", "top_mm"]

PRINT = Print(
    up=(0, -(0.5**0.5), -(0.5**0.5)),
    lies_on="the back of its sloping plate",
    infill_percent=40,
    note="The walls lean by exactly 45°, which every printer manages without supports.",
)
PLATE_MM, RAIL_MM, STOP_MM = 5.0, 3.0, 3.0
LIP_MM = 1.5
"""By how much the rails cover the mirror's edge."""
LIP_THICKNESS_MM = 2.0
UPPER_MM, LOWER_MM = 1.0, 5.0
"""How far the plate extends beyond the mirror."""


def build(layout: Layout) -> Part:
    """Return the mount."""
    plane, mirror = mirror_plane(layout), layout.rig.mirrors[0]
    half_width, half_length = (side / 2 for side in mirror.size_mm)
    seat = mirror.thickness_mm + SLIDE_MM
    reach = layout.wall_mm + FLOOR_MM
    low, high = -half_length - LOWER_MM, half_length + UPPER_MM
    inside, outside = half_width + SLIDE_MM, half_width + SLIDE_MM + RAIL_MM
    lip = (-SLIDE_MM - LIP_THICKNESS_MM, -SLIDE_MM)
    stop = -half_length - SLIDE_MM
    mount = slab(plane, (-reach, reach), (low, high), (seat, seat + PLATE_MM))
    mount += slab(plane, (-outside, outside), (stop - STOP_MM, stop), (lip[0], seat))
    for side in (-1, 1):
        rail = tuple(sorted((side * inside, side * outside)))
        cover = tuple(sorted((side * (half_width - LIP_MM), side * outside)))
        mount += slab(plane, rail, (stop, high), (lip[0], seat)) + slab(plane, cover, (stop, high), lip)
        wall = sorted((side * layout.wall_mm, side * reach))
        mount += prism(_wall_outline(layout, low, high, seat), Plane.YZ, *wall)
    for x_mm, z_mm in feet_of(layout)["mirror_mount"]:
        base = layout.base_mm
        mount -= rod((x_mm, base, z_mm), (x_mm, base + INSERT_DEPTH_MM, z_mm), INSERT_MM)
    return mount


def mirror(layout: Layout) -> Part:
    """Return the mirror itself."""
    mirror = layout.rig.mirrors[0]
    width, length = (side / 2 for side in mirror.size_mm)
    return slab(mirror_plane(layout), (-width, width), (-length, length), (0, mirror.thickness_mm))


def mirror_plane(layout: Layout) -> Plane:
    """Return the mirror's coordinates: right, up its slope, and behind its reflecting surface."""
    return Plane(origin=tuple(layout.mirror_center_mm), x_dir=(1, 0, 0), z_dir=(0, 1, 1))


def top_mm(layout: Layout) -> tuple[float, float]:
    """Return y and z of the plate's highest edge."""
    mirror = layout.rig.mirrors[0]
    up, behind = mirror.size_mm[1] / 2 + UPPER_MM, mirror.thickness_mm + SLIDE_MM + PLATE_MM
    return (up + behind) * 0.5**0.5, float(layout.mirror_center_mm[2]) + (behind - up) * 0.5**0.5


def _wall_outline(layout: Layout, low: float, high: float, seat: float) -> list[tuple[float, float]]:
    """Return the outline of a wall as (y, z): along the plate's back, then down to the base."""
    z, slope = layout.mirror_center_mm[2], 0.5**0.5
    behind = seat + PLATE_MM

    def at(up: float, back: float) -> tuple[float, float]:
        return (up + back) * slope, z + (back - up) * slope

    near, far = mirror_wall_mm(layout)
    return [
        at(high, seat),
        at(high, behind),
        at(low, behind),
        at(low, seat),
        (layout.base_mm, far),
        (layout.base_mm, near),
    ]
