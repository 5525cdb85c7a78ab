"""The camera's mount: four corner posts and a clamp for a housing, or stand-offs for a bare board.

The sides stay open between the posts, wherever the cable leaves.
"""

from itertools import product

from build123d import Part, Plane

from rig.feet import RIB_MM, feet_of
from rig.layout import FLOOR_MM, MOUNT_MM, Layout
from rig.shapes import prism, rod, slab
from rig.standard import CLEARANCE_MM, INSERT_DEPTH_MM, INSERT_MM, SLIDE_MM, Print

__all__ = [
    "BOARD_MM",
    "CLAMP_MM",
    "build",
    "build_clamp",
    "camera",
    "camera_plane",
    "corners_mm",
    "print_of",
    "print_of_clamp",
]

CLAMP_MM = 3.0
"""Thickness of the clamp."""
BOARD_MM = 1.6
"""Thickness of a circuit board."""
COVER_MM, HOLD_MM = 1.5, 2.0
"""By how much the clamp covers the front, and the posts the sides."""
STANDOFF_MM, BARREL_MM = 5.5, 16.0
RIB_FOOT_MM = 8.0
TAPPED = {"M2": 1.6, "M2.5": 2.1, "M3": 2.5}
FREE = {"M2": 2.4, "M2.5": 2.9, "M3": 3.4}
ALL_CORNERS = tuple(product((-1, 1), (-1, 1)))


def build(layout: Layout) -> Part:
    """Return the mount."""
    plane, (width, height, _) = camera_plane(layout), layout.rig.camera.body_mm
    right, up = width / 2 + MOUNT_MM, height / 2 + MOUNT_MM
    depth = layout.depth_mm
    mount = slab(plane, (-right, right), (-up, up), (depth, depth + FLOOR_MM))
    mount = _with_standoffs(layout, mount) if layout.is_board else _with_posts(layout, mount)
    if not layout.mirror:
        mount += _stand(layout, right)
    for x_mm, z_mm in feet_of(layout)["camera_mount"]:
        base = layout.base_mm
        mount -= rod((x_mm, base, z_mm), (x_mm, base + INSERT_DEPTH_MM, z_mm), INSERT_MM)
    return mount


def build_clamp(layout: Layout) -> Part:
    """Return the clamp that holds a housing down: a window with a screw at each corner."""
    plane, (width, height, _) = camera_plane(layout), layout.rig.camera.body_mm
    right, up = width / 2 + MOUNT_MM, height / 2 + MOUNT_MM
    clamp = slab(plane, (-right, right), (-up, up), (-SLIDE_MM - CLAMP_MM, -SLIDE_MM))
    window = (width / 2 - COVER_MM, height / 2 - COVER_MM)
    clamp -= slab(plane, (-window[0], window[0]), (-window[1], window[1]), (-10, 10))
    for right, up in corners_mm(layout):
        clamp -= rod(layout.camera.at(right, up, -10), layout.camera.at(right, up, 10), CLEARANCE_MM)
    return clamp


def camera(layout: Layout) -> Part:
    """Return the camera by its published dimensions: a housing, or a board with a lens."""
    plane, (width, height, depth) = camera_plane(layout), layout.rig.camera.body_mm
    sides = (-width / 2, width / 2), (-height / 2, height / 2)
    if not layout.is_board:
        return slab(plane, *sides, (0, depth))
    board = slab(plane, *sides, (depth - BOARD_MM, depth))
    for right, up in layout.rig.camera.screws_mm:
        ends = layout.camera.at(right, up, depth - 5), layout.camera.at(right, up, depth + 5)
        board -= rod(*ends, FREE[layout.rig.camera.screw])
    off_right, off_up = layout.rig.camera.pupil_off_mm
    return board + rod(
        layout.camera.at(off_right, off_up, 0), layout.camera.at(off_right, off_up, depth), BARREL_MM
    )


def camera_plane(layout: Layout) -> Plane:
    """Return the camera's coordinates: right and up as seen from behind it, and behind its front face."""
    pose = layout.camera
    return Plane(origin=tuple(pose.front_mm), x_dir=tuple(pose.right), z_dir=tuple(-pose.look))


def corners_mm(layout: Layout) -> list[tuple[float, float]]:
    """Return the clamp's screws, right and up."""
    width, height, _ = layout.rig.camera.body_mm
    right, up = width / 2 + MOUNT_MM - 4.5, height / 2 + MOUNT_MM - 4.5
    return [(x * right, y * up) for x, y in ALL_CORNERS]


def print_of(layout: Layout) -> Print:
    """Return how the mount is printed."""
    up = tuple(float(side) for side in layout.camera.look)
    return Print(up=up, lies_on="its back, flat", infill_percent=40)


def print_of_clamp(layout: Layout) -> Print:
    """Return how the clamp is printed."""
    return Print(up=print_of(layout).up, lies_on="either face, flat")


def _with_posts(layout: Layout, mount: Part) -> Part:
    plane, (width, height, depth) = camera_plane(layout), layout.rig.camera.body_mm
    for x, y in ALL_CORNERS:
        right = tuple(sorted((x * (width / 2 - HOLD_MM), x * (width / 2 + MOUNT_MM))))
        up = tuple(sorted((y * (height / 2 - HOLD_MM), y * (height / 2 + MOUNT_MM))))
        mount += slab(plane, right, up, (-SLIDE_MM, layout.depth_mm))
    half_width, half_height = width / 2 + SLIDE_MM, height / 2 + SLIDE_MM
    mount -= slab(plane, (-half_width, half_width), (-half_height, half_height), (-10, depth + SLIDE_MM))
    for right, up in corners_mm(layout):
        ends = layout.camera.at(right, up, -SLIDE_MM), layout.camera.at(right, up, INSERT_DEPTH_MM)
        mount -= rod(*ends, INSERT_MM)
    return mount


def _with_standoffs(layout: Layout, mount: Part) -> Part:
    depth = layout.rig.camera.body_mm[2]
    for right, up in layout.rig.camera.screws_mm:
        back, end = layout.camera.at(right, up, depth), layout.camera.at(right, up, layout.depth_mm + 1)
        mount += rod(back, end, STANDOFF_MM)
        mount -= rod(back, layout.camera.at(right, up, layout.depth_mm + 2), TAPPED[layout.rig.camera.screw])
    return mount


def _stand(layout: Layout, half_width_mm: float) -> Part:
    """Return what carries an upright mount: its plate, down to the base, and a rib below the camera."""
    x_mm, z_mm = layout.camera.front_mm[0], layout.camera.front_mm[2] + layout.depth_mm
    base, top = layout.base_mm, layout.camera.front_mm[1]
    plate = [(base, z_mm), (base, z_mm + FLOOR_MM), (top, z_mm + FLOOR_MM), (top, z_mm)]
    below = top - layout.rig.camera.body_mm[1] / 2 - MOUNT_MM
    front = z_mm - RIB_MM
    rib = [(base, z_mm + 1), (base, front), (base + RIB_FOOT_MM, front), (below, z_mm + 1)]
    stand = prism(plate, Plane.YZ, x_mm - half_width_mm, x_mm + half_width_mm)
    return stand + prism(rib, Plane.YZ, x_mm - 4.5, x_mm + 4.5)
