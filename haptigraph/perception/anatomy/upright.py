"""Judge by what moves outside the eye whether its image is upright: needles enter from above."""

from collections.abc import Sequence

import cv2
import numpy as np

from haptigraph.imaging import Mask
from haptigraph.messages import Image
from haptigraph.perception.anatomy.anatomy import Anatomy
from haptigraph.perception.anatomy.illumination import equalize_illumination
from haptigraph.perception.anatomy.moving_shaft import ILLUMINATION_RATIO, moving_mask
from haptigraph.perception.anatomy.rim import Rim

__all__ = ["MAX_SHARE_ABOVE", "enters_above", "moving_outside", "share_above"]

RING_RATIOS = 1.1, 1.4  # of the wall's outer radius: what moves there enters or leaves the eye
ABOVE_RATIO = 0.2  # of the radius above the centre, as for trocars
MIN_AREA_RATIO = 0.02  # of the radius squared: less motion shows nothing
MAX_SHARE_ABOVE = 0.1
"""Of what moves outside an eye whose image is rotated."""


def enters_above(images: Sequence[Image], anatomy: Anatomy) -> bool | None:
    """Return whether what moves outside the eye enters it from above; None if nothing moves there.

    If it does not, the image is rotated.

    Args:
        images: Images of one clip, at different times.
        anatomy: What was found in them.
    """
    moves = moving_outside(images, anatomy.reference_image, anatomy.rim)
    return None if moves is None else share_above(moves, anatomy.rim) >= MAX_SHARE_ABOVE


def moving_outside(images: Sequence[Image], reference: Image, rim: Rim) -> Mask | None:
    """Return where something moves just outside the eye, (h, w); None if hardly anything does.

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
    return moves if area >= MIN_AREA_RATIO * inner.radius_px**2 else None


def share_above(moves: Mask, rim: Rim) -> float:
    """Return the share of a mask, which is not empty, that is above the eye."""
    inner = rim.inner
    above = moves[: max(0, round(inner.center_px[1] - ABOVE_RATIO * inner.radius_px))]
    return float(above.sum() / moves.sum())
