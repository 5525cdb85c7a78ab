"""Judge by what moves outside the eye whether its image is upright: needles enter from above."""

from collections.abc import Sequence

import cv2
import numpy as np

from haptigraph.messages import Image
from haptigraph.perception.anatomy.anatomy import Anatomy
from haptigraph.perception.anatomy.illumination import equalize_illumination
from haptigraph.perception.anatomy.moving_shaft import ILLUMINATION_RATIO, moving_mask
from haptigraph.perception.anatomy.rim import Rim

__all__ = ["MAX_SHARE_ABOVE", "enters_elsewhere", "share_above"]

RING_RATIOS = 1.1, 1.4  # of the wall's outer radius: what moves there enters or leaves the eye
ABOVE_RATIO = 0.2  # of the radius above the centre, as for trocars
MIN_AREA_RATIO = 0.02  # of the radius squared: less motion shows nothing
MAX_SHARE_ABOVE = 0.1
"""Of what moves outside an eye whose image is rotated."""


def enters_elsewhere(images: Sequence[Image], anatomy: Anatomy) -> bool:
    """Return whether something moves outside the eye, and hardly any of it above: a rotated image.

    Args:
        images: Images of one clip, at different times.
        anatomy: What was found in them.
    """
    above = share_above(images, anatomy.reference_image, anatomy.rim)
    return above is not None and above < MAX_SHARE_ABOVE


def share_above(images: Sequence[Image], reference: Image, rim: Rim) -> float | None:
    """Return the share of what moves outside the eye that is above it; None if hardly anything moves.

    Args:
        images: Images of one clip, at different times.
        reference: Their median.
        rim: The globe's wall in it.
    """
    inner, outer = rim.inner, rim.outer or rim.inner
    relit = equalize_illumination(images, reference, ILLUMINATION_RATIO * inner.radius_px)
    moves = moving_mask(relit, rim)
    y, x = np.ogrid[: moves.shape[0], : moves.shape[1]]
    distance = np.hypot(x - inner.center_px[0], y - inner.center_px[1])
    near, far = (ratio * outer.radius_px for ratio in RING_RATIOS)
    moves &= (near < distance) & (distance < far)
    area = cv2.countNonZero(moves.astype(np.uint8))
    if area < MIN_AREA_RATIO * inner.radius_px**2:
        return None
    return int(moves[: max(0, round(inner.center_px[1] - ABOVE_RATIO * inner.radius_px))].sum()) / area
