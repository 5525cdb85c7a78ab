"""Equalise the illumination of images of one scene to that of a reference image."""

from collections.abc import Sequence

import cv2
import numpy as np

from haptigraph.imaging import Floats, grey_of
from haptigraph.messages import Image

__all__ = ["equalize_illumination"]

CELL_PX = 8  # side of the cells in which brightness is measured
STEPS, NO_CHANGE = 100, 128  # encoding of log brightness ratios in a byte: steps per unit, value of ratio 1
STEADY_STEPS = 3  # smaller changes are ignored


def equalize_illumination(images: Sequence[Image], reference: Image, width_px: float) -> list[Image]:
    """Scale the brightness of images by its median change in a neighbourhood of every pixel.

    Args:
        images: (h, w, 3) BGR or (h, w) grey each; those lit like `reference` are returned unchanged.
        reference: The same scene without the thin objects that move.
        width_px: Width of the neighbourhood, over which the illumination changes uniformly.
    """
    typical, kernel = _cell_brightness(reference), 2 * round(width_px / CELL_PX / 2) + 1
    return [_relit(image, np.log(typical / _cell_brightness(image)), kernel) for image in images]


def _relit(image: Image, change: Floats, kernel: int) -> Image:
    """Apply to an image the logarithm of a brightness ratio, given per cell."""
    stepped = np.clip(np.rint(STEPS * change) + NO_CHANGE, 0, 255).astype(np.uint8)
    typical = cv2.medianBlur(stepped, kernel).astype(np.float32) - NO_CHANGE
    if np.abs(typical).max() <= STEADY_STEPS:
        return image
    gain = np.exp(cv2.resize(cv2.blur(typical, (kernel, kernel)), image.shape[1::-1]) / STEPS)
    gain = gain if image.ndim == 2 else gain[..., None]
    return np.asarray(np.clip(np.rint(image * gain), 0, 255), np.uint8)


def _cell_brightness(image: Image) -> Floats:
    """Return the mean brightness of every cell, plus 1 to avoid log 0."""
    height, width = image.shape[:2]
    size = -(-width // CELL_PX), -(-height // CELL_PX)
    return cv2.resize(grey_of(image), size, interpolation=cv2.INTER_AREA).astype(float) + 1.0
