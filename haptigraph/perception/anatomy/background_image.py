"""Find what a moving needle hides: the empty eye, pixel by pixel from the images in which it is elsewhere.

Images of one clip and where its anatomy lies in, the picture without needle out. What it covers in all of
them stays unknown.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from haptigraph.imaging import colored, tilt_corrected
from haptigraph.messages import Image
from haptigraph.perception.needle.background import occluded_ends, stripe
from haptigraph.perception.needle.rectify import EyeGeometry
from haptigraph.perception.needle.tip_selection import Detection
from haptigraph.perception.needle.tracker import detections_in
from haptigraph.registration.background import BackgroundImage
from haptigraph.registration.camera import Registration

__all__ = ["find_background_image"]

LEAST_LOOKS = 3  # at a pixel, of which one may be wrong
LEAST_DETECTIONS = 3  # of the needle: a needle that is not seen would be taken for the eye
BEYOND_MM = 1.0  # the tip may reach so much further than it is told


def find_background_image(
    images: Sequence[Image], still: Image, registration: Registration
) -> BackgroundImage | None:
    """Return the eye without needle.

    Args:
        images: Of one clip, in order, (h, w, 3) BGR or (h, w) grey.
        still: What most of them show.
        registration: Where the anatomy lies in them.

    Returns:
        None if no needle is seen in enough of them: one that lies still would be taken for the eye.
    """
    way, frontal = registration.image.frontal_from_image, registration.frontal
    sights = detections_in((tilt_corrected(image, way) for image in images) if way else images, frontal)
    if len(sights) - sights.count(None) < LEAST_DETECTIONS:
        return None
    eye, is_free = EyeGeometry(frontal), np.ones((len(images), *still.shape[:2]), np.bool_)
    for number, sight in enumerate(sights):
        if sight is not None:
            hidden = _hidden(eye, sight)
            is_free[number] = (tilt_corrected(hidden, way.inverse) if way else hidden) == 0
    looks = np.count_nonzero(is_free, axis=0)
    picture, is_some = colored(still).copy(), (looks >= LEAST_LOOKS) & (looks < len(images))
    seen = np.stack([colored(image)[is_some] for image in images]).astype(np.float32)
    seen[~is_free[:, is_some]] = np.inf
    seen.sort(axis=0)
    middle = (looks[is_some] - 1) // 2
    picture[is_some] = np.take_along_axis(seen, middle[None, :, None], axis=0)[0]
    return BackgroundImage(picture, looks >= LEAST_LOOKS)


def _hidden(eye: EyeGeometry, sight: Detection) -> Image:
    """Return what a needle may hide, (h, w): 255 there."""
    ends = occluded_ends(eye, sight.line, sight.reach.u_px + BEYOND_MM * eye.px_per_mm)
    hidden = np.zeros((eye.height_px, eye.width_px), np.uint8)
    cv2.fillConvexPoly(hidden, stripe(ends, 2 * eye.half_px, (0.0, 0.0)), 255, shift=4)
    return hidden
