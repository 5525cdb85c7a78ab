"""Light that changes from image to image, as cameras and lamps that are not steady make it.

Turns images of one scene into the same in one light, that of their still picture. Knows no eye.
"""

from collections.abc import Sequence

import cv2
import numpy as np

from haptigraph.imaging import Floats, grey_of
from haptigraph.messages import Image

__all__ = ["evenly_lit"]

CELL_PX = 8  # in which light is measured
STEPS, UNCHANGED = 100, 128  # of log brightness in a byte; no change
STEADY_STEPS = 3  # make no difference


def evenly_lit(images: Sequence[Image], still: Image, width_px: float) -> list[Image]:
    """Return images in one light, by the median change in the surroundings of every place.

    Args:
        images: (h, w, 3) BGR or (h, w) grey each; the same where the light is that of `still`.
        still: Of the same scene, without the thin things that move.
        width_px: Of the surroundings: light changes alike over so much.
    """
    usual, side = _cells(still), 2 * round(width_px / CELL_PX / 2) + 1
    return [_lit(image, np.log(usual / _cells(image)), side) for image in images]


def _lit(image: Image, change: Floats, side: int) -> Image:
    """Return an image in other light, given how many times brighter that is in every cell, as a logarithm."""
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
