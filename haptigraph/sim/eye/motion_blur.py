"""Motion blur: the straight path that a camera's motion during the exposure draws, as a filter kernel."""

import math

import numpy as np

from haptigraph.imaging import FloatImage

__all__ = ["line_kernel"]

SAMPLES_PER_PX = 20


def line_kernel(length_px: float, angle_deg: float) -> FloatImage:
    """Return the kernel of a uniform motion along a straight line; its sum is 1.

    Args:
        length_px: Length of the motion during the exposure.
        angle_deg: Its direction in the image, from x towards y (clockwise as seen).

    Returns:
        (n, n) with odd n, symmetric about its centre, so that the blur shifts nothing.
    """
    half = math.ceil(length_px / 2) + 1
    count = max(2 * math.ceil(SAMPLES_PER_PX * length_px / 2) + 1, 1)
    along_px = np.linspace(-length_px / 2, length_px / 2, count)
    x = half + along_px * math.cos(math.radians(angle_deg))
    y = half + along_px * math.sin(math.radians(angle_deg))
    grid = np.arange(2 * half + 1)
    columns = np.clip(1 - np.abs(grid - x[:, None]), 0, 1)
    rows = np.clip(1 - np.abs(grid - y[:, None]), 0, 1)
    kernel: FloatImage = (np.einsum("ny,nx->yx", rows, columns) / count).astype(np.float32)
    return kernel
