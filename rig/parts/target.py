"""The exchangeable target: a pin with a head, pressed from the front into slots of retina shell and eye."""

from build123d import Part

from rig.layout import Layout
from rig.parts.eye import target_plane
from rig.shapes import slab
from rig.standard import SLIDE_MM, Print

__all__ = ["PRINT", "build"]

PRINT = Print(
    up=(0, 0, 1),
    lies_on="its back, flat",
    color="black or dark blue, matt",
    layer_mm=0.12,
    infill_percent=100,
    min_wall_mm=0.5,
    note="Print six at a time, so that each layer cools.",
)
HEAD_MM = (2.0, 3.0)
"""How far the head extends to each side, and its length."""


def build(layout: Layout) -> Part:
    """Return the pin; its inner end is tangential to the globe, its front flush with the cut face."""
    eye, half = layout.rig.eye, layout.rig.eye.target_mm / 2
    depth, plane = (-half, eye.cut_mm), target_plane(layout)
    neck_mm = layout.bulge_mm + SLIDE_MM
    side, length = HEAD_MM
    pin = slab(plane, (-half, half), depth, (layout.radius_mm, neck_mm + 1))
    return pin + slab(plane, (-half - side, half + side), depth, (neck_mm, neck_mm + length))
