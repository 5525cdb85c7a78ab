"""Find what a moving needle hides: the empty eye, pixel by pixel from the images in which it is elsewhere.

Images of one clip and where its anatomy lies in, the picture without needle out. What it covers in all of
them stays unknown.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from haptigraph.imaging import colored, straightened
from haptigraph.messages import Image
from haptigraph.perception.needle.background import covered_ends, stripe
from haptigraph.perception.needle.rectify import Site
from haptigraph.perception.needle.tip_selection import Sight
from haptigraph.perception.needle.tracker import sights_in
from haptigraph.registration.background import EmptyEye
from haptigraph.registration.camera import Registration

__all__ = ["find_empty_eye"]

LEAST_LOOKS = 3  # at a pixel, of which one may be wrong
LEAST_SIGHTS = 3  # of the needle: a needle that is not seen would be taken for the eye
BEYOND_MM = 1.0  # the tip may reach so much further than it is told


def find_empty_eye(images: Sequence[Image], still: Image, registration: Registration) -> EmptyEye | None:
    """Return the eye without needle.

    Args:
        images: Of one clip, in order, (h, w, 3) BGR or (h, w) grey.
        still: What most of them show.
        registration: Where the anatomy lies in them.

    Returns:
        None if no needle is seen in enough of them: one that lies still would be taken for the eye.
    """
    way, straight = registration.image.straight_from_image, registration.straight
    sights = sights_in((straightened(image, way) for image in images) if way else images, straight)
    if len(sights) - sights.count(None) < LEAST_SIGHTS:
        return None
    site, is_free = Site(straight), np.ones((len(images), *still.shape[:2]), np.bool_)
    for number, sight in enumerate(sights):
        if sight is not None:
            hidden = _hidden(site, sight)
            is_free[number] = (straightened(hidden, way.inverse) if way else hidden) == 0
    looks = np.count_nonzero(is_free, axis=0)
    picture, is_some = colored(still).copy(), (looks >= LEAST_LOOKS) & (looks < len(images))
    seen = np.stack([colored(image)[is_some] for image in images]).astype(np.float32)
    seen[~is_free[:, is_some]] = np.inf
    seen.sort(axis=0)
    middle = (looks[is_some] - 1) // 2
    picture[is_some] = np.take_along_axis(seen, middle[None, :, None], axis=0)[0]
    return EmptyEye(picture, looks >= LEAST_LOOKS)


def _hidden(site: Site, sight: Sight) -> Image:
    """Return what a needle may hide, (h, w): 255 there."""
    ends = covered_ends(site, sight.line, sight.reach.tip_px + BEYOND_MM * site.px_per_mm)
    hidden = np.zeros((site.height_px, site.width_px), np.uint8)
    cv2.fillConvexPoly(hidden, stripe(ends, 2 * site.half_px, (0.0, 0.0)), 255, shift=4)
    return hidden
