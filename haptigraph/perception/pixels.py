"""Names for arrays of pixels, and the way from any image to grey. Shared by all of perception."""

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.messages import Image

__all__ = ["FloatImage", "Floats", "Mask", "grey_of"]

FloatImage: TypeAlias = NDArray[np.float32]
Floats: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]


def grey_of(image: Image) -> Image:
    """Return an image in grey."""
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
