"""Names for arrays of pixels, and the way from any image to grey. Shared by all of perception."""

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.messages import Image

__all__ = ["FloatImage", "Floats", "Mask", "grey_of", "top_shift"]

FloatImage: TypeAlias = NDArray[np.float32]
Floats: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]


def grey_of(image: Image) -> Image:
    """Return an image in grey."""
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


def top_shift(before: Floats, at: Floats, after: Floats) -> Floats:
    """Return how far from the middle one of three samples the parabola through them has its top, (n,).

    In steps of the samples, -0.5 to 0.5; 0 where they have none.
    """
    bend = before - 2 * at + after
    shift = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, 1), 0)
    return np.clip(shift, -0.5, 0.5)
