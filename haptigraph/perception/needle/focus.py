"""How blurred a picture is: an image -> the standard deviation of its blur.

All around an eye, its registered rim is an edge in the plane of the section, as the needle is. A shaft shows
the blur less well: where it is as bright as the ground, only rims and a highlight remain of it, which blur
makes faint rather than wide.
"""

import math

import cv2
import numpy as np

from haptigraph.imaging import FloatImage, grey_of
from haptigraph.messages import Image
from haptigraph.perception.needle.rectify import RIM_MISS_MM, EyeGeometry, median

__all__ = ["Focus"]

EVERY = 16  # images between two measurements
RAYS, MIN_RAYS = 60, 8  # around the globe, and with an edge
MIN_REACH_PX = 6  # to either side of the rim
TAP_PX = np.arange(-3, 4)
SLOPE = TAP_PX * np.exp(-(TAP_PX**2) / 2)  # as `native/edges.c` across a shaft
SLOPE_BLUR_PX2 = 1.25  # of this filter, and of taking a maximum's curvature from its neighbours
MIN_SHARE = 0.5  # of the usual slope
SHARP_SHARE = 0.25  # of the rays, which motion and anatomy blur least
RIM_PX = 0.25  # by which the rim is softer than a shaft


class Focus:
    """The blur of a picture, at the registered rim of one eye.

    Args:
        eye: The eye's geometry.
    """

    def __init__(self, eye: EyeGeometry) -> None:
        reach_px = max(round(RIM_MISS_MM * eye.px_per_mm), MIN_REACH_PX) + TAP_PX[-1]
        radius_px = eye.inner_px + np.arange(-reach_px, reach_px + 1)
        (x_px, y_px), in_view = eye.rays(radius_px, RAYS)
        self._positions_px = x_px[in_view], y_px[in_view]
        self.reset()

    def reset(self) -> None:
        """Forget earlier images."""
        self._images = 0
        self.blur_px = 0.0
        """Standard deviation of the blur; 0 where the rim does not show it."""

    def measure(self, image: Image) -> None:
        """Measure the blur, in one image out of 16.

        Args:
            image: (h, w, 3) BGR or (h, w) grey.
        """
        if self._images % EVERY == 0 and len(self._positions_px[0]) >= MIN_RAYS:
            rays = np.asarray(cv2.remap(image, *self._positions_px, cv2.INTER_LINEAR), np.uint8)
            self.blur_px = _blur_px(np.asarray(grey_of(rays), np.float32))
        self._images += 1


def _blur_px(rays: FloatImage) -> float:
    """Return the blur of the edges along rays, (n, length), one each; 0 if too few have one."""
    slope = np.abs(np.lib.stride_tricks.sliding_window_view(rays, len(SLOPE), axis=1) @ SLOPE)
    at, ray = slope[:, 1:-1].argmax(axis=1) + 1, np.arange(len(slope))
    height = slope[ray, at]
    curvature = 2 * height - slope[ray, at - 1] - slope[ray, at + 1]
    is_edge = (curvature > 0) & (height >= MIN_SHARE * median(height))
    variances_px2 = np.sort(height[is_edge] / curvature[is_edge]) - SLOPE_BLUR_PX2
    if len(variances_px2) < MIN_RAYS:
        return 0.0
    variance_px2 = float(variances_px2[int(SHARP_SHARE * len(variances_px2))])
    return max(math.sqrt(max(variance_px2, 0.0)) - RIM_PX, 0.0)
