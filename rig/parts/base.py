"""The base plate that joins everything: M3 screws come up through it into inserts; their heads are sunk."""

from build123d import Axis, Part, chamfer, fillet

from rig.feet import feet_of
from rig.layout import Layout, Screw
from rig.shapes import block, rod
from rig.standard import CLEARANCE_MM, HEAD_MM, Print

__all__ = ["PRINT", "build", "screws_of"]

PRINT = Print(up=(0, 1, 0), lies_on="the face with the sunk screw heads", infill_percent=40)
THICKNESS_MM, MARGIN_MM, SINK_MM, CORNER_MM, EDGE_MM = 7.0, 10.0, 3.4, 8.0, 1.0
LENGTH_MM = 8.0


def build(layout: Layout) -> Part:
    """Return the plate."""
    points = [point for feet in feet_of(layout).values() for point in feet]
    x_mm, z_mm = zip(*points, strict=True)
    top, bottom = layout.base_mm, layout.base_mm - THICKNESS_MM
    sides = [(min(side) - MARGIN_MM, max(side) + MARGIN_MM) for side in (x_mm, z_mm)]
    plate = block(sides[0], (bottom, top), sides[1])
    plate = Part() + fillet(plate.edges().filter_by(Axis.Y), CORNER_MM)
    plate = Part() + chamfer(plate.faces().sort_by(Axis.Y)[-1].edges(), EDGE_MM)
    for x, z in points:
        plate -= rod((x, bottom - 1, z), (x, top + 1, z), CLEARANCE_MM)
        plate -= rod((x, bottom, z), (x, bottom + SINK_MM, z), HEAD_MM[0] + 0.7)
    return plate


def screws_of(layout: Layout) -> list[Screw]:
    """Return the screws from below."""
    y = layout.base_mm - THICKNESS_MM + SINK_MM
    points = [point for feet in feet_of(layout).values() for point in feet]
    return [Screw((x, y, z), (0.0, 1.0, 0.0), LENGTH_MM) for x, z in points]
