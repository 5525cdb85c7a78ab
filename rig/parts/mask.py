"""The face mask: a dome with nose, orbit and the other eye's lid. It rests on four posts, and lifts off."""

import math

from build123d import Ellipse, Part, Plane, Pos, Sphere, extrude, scale

from rig.feet import POST_MM, mask_middle_mm
from rig.layout import FLOOR_MM, Layout
from rig.parts import mirror_mount
from rig.parts.frame import top_mm
from rig.shapes import block, rod
from rig.standard import INSERT_DEPTH_MM, INSERT_MM, SLIDE_MM, Print

__all__ = ["ORBIT_MM", "POST", "PRINT", "RIM_MM", "build", "build_post", "height_mm"]

PRINT = Print(
    up=(0, 1, 0),
    lies_on="its rim",
    supports="inside, under the dome",
    color="skin, matt",
    infill_percent=10,
)
POST = Print(up=(0, 1, 0), lies_on="either end", infill_percent=40)
RIM_MM = -12.0
"""y of the rim."""
ORBIT_MM = (34.0, 23.0)
"""Half axes of the opening above the eye."""
HALF_MM = (88.0, 72.0)
"""Half axes of the face."""
WALL_MM = 2.4
ABOVE_MM = 2.5
"""Between the mirror's mount and the dome."""
NOTCH_MM = 1.5
POST_DIAMETER_MM, SOCKET_MM, LUG_MM = 12.0, 10.0, 18.0


def build(layout: Layout) -> Part:
    """Return the mask."""
    height, middle = height_mm(layout), mask_middle_mm(layout)
    outer, inner = (_face(layout, height, less) for less in (0.0, WALL_MM))
    mask = outer - inner
    lugs = [rod((x, RIM_MM, z), (x, height, z), LUG_MM) for x, z in _posts(middle)]
    mask += outer & (lugs[0] + lugs[1] + lugs[2] + lugs[3])
    mask -= block((-200, 200), (-200, RIM_MM), (-200, 300))
    for x, z in _posts(middle):
        mask -= rod((x, RIM_MM - 1, z), (x, RIM_MM + SOCKET_MM, z), POST_DIAMETER_MM + 2 * SLIDE_MM)
    orbit = extrude(Plane.XZ * Ellipse(*ORBIT_MM), 100, both=True)
    aside, back = top_mm(layout) + NOTCH_MM, layout.back_mm + NOTCH_MM
    notch = block((-aside, aside), (RIM_MM - 1, 200), (-200, back))  # for the eye's frame
    return Part() + mask - orbit - notch


def build_post(layout: Layout, index: int) -> Part:
    """Return one of the four posts."""
    x, z = _posts(mask_middle_mm(layout))[index]
    top = RIM_MM + SOCKET_MM - SLIDE_MM
    post = rod((x, layout.base_mm, z), (x, top, z), POST_DIAMETER_MM)
    return post - rod((x, layout.base_mm, z), (x, layout.base_mm + INSERT_DEPTH_MM, z), INSERT_MM)


def height_mm(layout: Layout) -> float:
    """Return y of the dome's top: its inside clears the corners of the mirror's mount."""
    y_mm, z_mm = mirror_mount.top_mm(layout)
    x_share = (layout.wall_mm + FLOOR_MM) / (HALF_MM[0] - WALL_MM)
    z_share = (z_mm - mask_middle_mm(layout)) / (HALF_MM[1] - WALL_MM)
    inside = (y_mm + ABOVE_MM - RIM_MM) / math.sqrt(1 - x_share**2 - z_share**2)
    return RIM_MM + inside + WALL_MM


def _face(layout: Layout, height: float, less: float) -> Part:
    """Return the solid face, or what is inside it."""
    middle = mask_middle_mm(layout)
    ball = Sphere(1, rotation=(90, 0, 0))  # its poles above and below, where no other face passes
    dome = scale(ball, by=(HALF_MM[0] - less, height - RIM_MM - less, HALF_MM[1] - less))
    nose = scale(ball, by=(32 - less, 30 - less, 15 - less))
    lid = scale(ball, by=(19 - less, 13 - less, 15 - less))
    face = Part() + Pos(0, RIM_MM, middle) * dome
    face += Pos(-34, height - 16, middle) * nose
    return face + Pos(0, height - 12, middle + 34) * lid


def _posts(middle: float) -> list[tuple[float, float]]:
    return [(x, middle + z) for x in (-POST_MM[0], POST_MM[0]) for z in (-POST_MM[1], POST_MM[1])]
