"""Compose the background image of a clip: every pixel's median over images where no needle occludes it.

Pixels that the needle occludes in too many images stay unknown.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from haptigraph.imaging import colored, tilt_corrected, tilt_restored
from haptigraph.messages import Image
from haptigraph.perception.needle.background import occluded_ends, stripe
from haptigraph.perception.needle.rectify import EyeGeometry
from haptigraph.perception.needle.tip_selection import Detection
from haptigraph.perception.needle.tracker import detections_in
from haptigraph.registration.background import BackgroundImage
from haptigraph.registration.camera import Registration

__all__ = ["find_background_image"]

MIN_UNOCCLUDED = 3  # images per pixel, of which one may be an outlier
MIN_DETECTIONS = 3  # an undetected needle would become part of the background
TIP_MARGIN_MM = 1.0  # beyond the estimated tip


def find_background_image(
    images: Sequence[Image], reference: Image, registration: Registration
) -> BackgroundImage | None:
    """Return the background image: the eye without needle.

    Args:
        images: Images of one clip, in order, (h, w, 3) BGR or (h, w) grey.
        reference: Their median.
        registration: Position of the anatomy in them.

    Returns:
        None if too few images have a needle detection: a needle at rest would become part of the background.
    """
    image_map, frontal = registration.image.frontal_from_image, registration.frontal
    views = (tilt_corrected(image, image_map) for image in images) if image_map else images
    detections = detections_in(views, frontal)
    if len(detections) - detections.count(None) < MIN_DETECTIONS:
        return None
    eye, is_free = EyeGeometry(frontal), np.ones((len(images), *reference.shape[:2]), np.bool_)
    for number, detection in enumerate(detections):
        if detection is not None:
            occluded = _occluded(eye, detection)
            is_free[number] = (tilt_restored(occluded, image_map) if image_map else occluded) == 0
    unoccluded = np.count_nonzero(is_free, axis=0)
    background, is_known = colored(reference).copy(), unoccluded >= MIN_UNOCCLUDED
    is_replaced = is_known & (unoccluded < len(images))
    values = np.stack([colored(image)[is_replaced] for image in images]).astype(np.float32)
    values[~is_free[:, is_replaced]] = np.inf
    values.sort(axis=0)
    median = (unoccluded[is_replaced] - 1) // 2
    background[is_replaced] = np.take_along_axis(values, median[None, :, None], axis=0)[0]
    return BackgroundImage(background, is_known)


def _occluded(eye: EyeGeometry, detection: Detection) -> Image:
    """Return the region that a needle may occlude, (h, w): 255 inside."""
    ends = occluded_ends(eye, detection.line, detection.tip.u_px + TIP_MARGIN_MM * eye.px_per_mm)
    occluded = np.zeros((eye.height_px, eye.width_px), np.uint8)
    cv2.fillConvexPoly(occluded, stripe(ends, 2 * eye.half_px, (0.0, 0.0)), 255, shift=4)
    return occluded
