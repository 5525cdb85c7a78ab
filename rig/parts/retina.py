"""The exchangeable retina shell: slides into the eye from the front; a peg behind pushes it out again."""

import math

from build123d import Part

from rig.layout import Layout
from rig.parts.eye import PEG_MM, in_front, peg_mm, target_slot
from rig.shapes import ball, block, rod
from rig.standard import PRESS_MM, Print

__all__ = ["PRINT", "build"]

PRINT = Print(
    up=(0, 0, 1),
    lies_on="supports; the cut face is up, so that the inner surface, which the camera sees, stays clean",
    supports="outside only, under the shell and around the peg",
    color="orange or red, matt",
    layer_mm=0.12,
    infill_percent=100,
    min_wall_mm=0.6,
)


def build(layout: Layout) -> Part:
    """Return the shell."""
    eye, y_mm = layout.rig.eye, peg_mm(layout)
    outer_mm = layout.radius_mm + eye.retina_mm
    far = (-100.0, 100.0)
    shell = ball(outer_mm) & block(far, (-100, layout.retina_edge_mm), far)
    shell += rod((0, y_mm, -math.sqrt(outer_mm**2 - y_mm**2) + 0.8), (0, y_mm, layout.back_mm + 1.5), PEG_MM)
    shell &= in_front(eye.cut_mm)
    return shell - ball(layout.radius_mm) - target_slot(layout, PRESS_MM)
