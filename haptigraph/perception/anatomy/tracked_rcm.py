"""Measure the pivot of a moving needle anew, with the eyes that will follow it.

Images of one clip, the wall and about where the needle pivots in, the pivot out. The tracker's lines are
mostly surer than those it was found by: it knows where to look, and how light shifts a shaft's edges.
"""

from collections.abc import Sequence

import numpy as np

from haptigraph.geometry import Circle, ImageGeometry, Point, Polyline, Vec
from haptigraph.messages import Image
from haptigraph.perception.anatomy.rcm import Rcm, ShaftLine, meeting
from haptigraph.perception.anatomy.rim import Rim
from haptigraph.perception.needle.shaft_line import BLOCK_PX
from haptigraph.perception.needle.tip_selection import Detection
from haptigraph.perception.needle.tracker import detections_in
from haptigraph.registration.camera import Registration

__all__ = ["tracked_rcm"]

RADIUS_MM = 12.0  # of a usual eye: the tracker's limits are in millimetres


def tracked_rcm(images: Sequence[Image], rim: Rim, about_px: Vec) -> Rcm | None:
    """Measure where the shaft's lines meet.

    Args:
        images: Of one clip, in order.
        rim: Where the wall is.
        about_px: Where the needle pivots, roughly.

    Returns:
        None if too few lines are seen, or they do not meet in the wall.
    """
    sights = detections_in(images, _provisional(images[0], rim, about_px))
    lines = [_line(sight, about_px) for sight in sights if sight and sight.reach.where == "inside"]
    return meeting(lines, rim)


def _provisional(image: Image, rim: Rim, trocar_px: Vec) -> Registration:
    geometry = ImageGeometry(rim.inner.center_px, RADIUS_MM / rim.inner.radius_px, mirrored=False)
    height_px, width_px = image.shape[:2]
    bottom = 0.0, -RADIUS_MM
    return Registration(
        width_px,
        height_px,
        geometry,
        text="",
        globe=Circle((0.0, 0.0), RADIUS_MM),
        retina=Polyline((bottom,)),
        target=Point(bottom),
        trocar=Point(geometry.to_mm(trocar_px)),
        other_trocars=(),
    )


def _line(sight: Detection, trocar_px: Vec) -> ShaftLine:
    seen_px = sight.fit.u_px[sight.fit.is_on_line]
    middle_px = sight.line.at_px(trocar_px, float(seen_px.mean()))
    return ShaftLine(np.array(middle_px), np.array(sight.line.direction), len(seen_px) * BLOCK_PX)
