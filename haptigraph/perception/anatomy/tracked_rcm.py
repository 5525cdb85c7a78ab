"""Refine the remote centre of motion (RCM) of a moving needle with the shaft lines that the tracker measures.

They are mostly more accurate than those of `moving_shaft`: the tracker predicts where the shaft is and
corrects the effect of the illumination on its edges.
"""

from collections.abc import Sequence

import numpy as np

from haptigraph.geometry import Circle, Point, Polyline, Vec
from haptigraph.messages import Image
from haptigraph.perception.anatomy.rcm import Rcm, ShaftLine, fit_rcm
from haptigraph.perception.anatomy.rim import Rim
from haptigraph.perception.needle.shaft_line import BLOCK_PX
from haptigraph.perception.needle.tip_selection import Detection
from haptigraph.perception.needle.tracker import detections_in
from haptigraph.projection import ImageGeometry
from haptigraph.registration.camera import Registration

__all__ = ["tracked_rcm"]

RADIUS_MM = 12.0  # of a typical eye: the tracker's limits are in millimetres


def tracked_rcm(images: Sequence[Image], rim: Rim, about_px: Vec) -> Rcm | None:
    """Measure the RCM.

    Args:
        images: Images of one clip, in order.
        rim: The globe's wall.
        about_px: The approximate RCM.

    Returns:
        None if there are too few lines, or they do not meet in the wall.
    """
    detections = detections_in(images, _provisional(images[0], rim, about_px))
    inside = [detection for detection in detections if detection and detection.tip.where == "inside"]
    return fit_rcm([_line(detection, about_px) for detection in inside], rim)


def _provisional(image: Image, rim: Rim, trocar_px: Vec) -> Registration:
    geometry = ImageGeometry(rim.inner.center_px, RADIUS_MM / rim.inner.radius_px, mirrored=False)
    height_px, width_px = image.shape[:2]
    bottom = 0.0, -RADIUS_MM
    return Registration(
        width_px=width_px,
        height_px=height_px,
        image=geometry,
        text="",
        globe=Circle((0.0, 0.0), RADIUS_MM),
        retina=Polyline((bottom,)),
        target=Point(bottom),
        trocar=Point(geometry.to_mm(trocar_px)),
        other_trocars=(),
    )


def _line(detection: Detection, trocar_px: Vec) -> ShaftLine:
    inlier_px = detection.fit.u_px[detection.fit.is_on_line]
    middle_px = detection.line.at_px(trocar_px, float(inlier_px.mean()))
    return ShaftLine(np.array(middle_px), np.array(detection.line.direction), len(inlier_px) * BLOCK_PX)
