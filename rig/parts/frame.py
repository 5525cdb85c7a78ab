"""The frame: an upright plate behind the eye that holds it by two screws, with a rib."""

from build123d import Part, Plane

from rig.feet import RIB_MM, feet_of
from rig.layout import FLOOR_MM, Layout
from rig.parts.eye import boss_mm, inserts_mm, peg_mm
from rig.shapes import prism, rod
from rig.standard import CLEARANCE_MM, INSERT_DEPTH_MM, INSERT_MM, Print

__all__ = ["PRINT", "build", "top_mm"]

PRINT = Print(up=(0, 0, -1), lies_on="its front, flat; the rib is up", infill_percent=40)
EJECTOR_MM, AROUND_MM = 7.0, 5.0
FOOT_MM, RIB_HEIGHT_SHARE, RIB_HALF_MM = 22.0, 0.6, 4.5


def build(layout: Layout) -> Part:
    """Return the frame."""
    front, back = layout.back_mm, layout.back_mm - FLOOR_MM
    round_mm, base = top_mm(layout), layout.base_mm
    outline = [(-FOOT_MM, base), (FOOT_MM, base), (round_mm, 0), (-round_mm, 0)]
    frame = prism(outline, Plane.XY, back, front) + rod((0, 0, back), (0, 0, front), 2 * round_mm)
    top = base * (1 - RIB_HEIGHT_SHARE)
    rib = [(base, back - RIB_MM), (base, back + 1), (top, back + 1)]
    frame += prism(rib, Plane.YZ, -RIB_HALF_MM, RIB_HALF_MM)
    for x_mm in inserts_mm(layout):
        frame -= rod((x_mm, 0, back - 1), (x_mm, 0, front + 1), CLEARANCE_MM)
    y_mm = peg_mm(layout)
    frame -= rod((0, y_mm, back - 1), (0, y_mm, front + 1), EJECTOR_MM)
    for x_mm, z_mm in feet_of(layout)["frame"]:
        frame -= rod((x_mm, base, z_mm), (x_mm, base + INSERT_DEPTH_MM, z_mm), INSERT_MM)
    return frame


def top_mm(layout: Layout) -> float:
    """Return the radius of the plate's round top."""
    return boss_mm(layout) + AROUND_MM
