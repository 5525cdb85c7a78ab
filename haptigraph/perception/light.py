"""Light that changes from image to image, as cameras and lamps that are not steady make it.

Turns an image and another of the same scene into the image as it would be in the other's light. Knows no eye.
"""

import cv2
import numpy as np

from haptigraph.messages import Image
from haptigraph.perception.pixels import Floats, grey_of

__all__ = ["lit_as"]

CELL_PX = 8  # in which light is measured
STEPS, UNCHANGED = 100, 128  # of log brightness in a byte; no change
STEADY_STEPS = 3  # make no difference


def lit_as(other: Image, image: Image, width_px: float) -> Image:
    """Return an image in the light of another, by the median change in the surroundings of every place.

    Args:
        other: Of the same scene, but for thin things that move.
        image: (h, w, 3) BGR or (h, w) grey; returned itself if the light is the same.
        width_px: Of the surroundings: light changes alike over so much.
    """
    change = np.log(_cells(other) / _cells(image))
    side = 2 * round(width_px / CELL_PX / 2) + 1
    stepped = np.clip(np.rint(STEPS * change) + UNCHANGED, 0, 255).astype(np.uint8)
    usual = cv2.medianBlur(stepped, side).astype(np.float32) - UNCHANGED
    if np.abs(usual).max() <= STEADY_STEPS:
        return image
    gain = np.exp(cv2.resize(cv2.blur(usual, (side, side)), image.shape[1::-1]) / STEPS)
    gain = gain if image.ndim == 2 else gain[..., None]
    return np.asarray(np.clip(np.rint(image * gain), 0, 255), np.uint8)


def _cells(image: Image) -> Floats:
    """Return how bright an image is in the mean, cell by cell; never 0."""
    height, width = image.shape[:2]
    size = -(-width // CELL_PX), -(-height // CELL_PX)
    return cv2.resize(grey_of(image), size, interpolation=cv2.INTER_AREA).astype(float) + 1.0
