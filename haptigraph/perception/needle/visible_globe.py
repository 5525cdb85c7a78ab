"""Whether the registered globe is in the picture at all: else, what looks like a needle is none.

Turns an image into a yes or no. All around an eye, an edge runs along the registered rim and nowhere near it;
in another picture, or where the eye has moved, edges are as strong at other radii.
"""

import cv2
import numpy as np

from haptigraph.imaging import grey_of
from haptigraph.messages import Image
from haptigraph.perception.needle.rectify import RIM_MISS_MM, EyeGeometry

__all__ = ["VisibleGlobe"]

SECTORS, RAYS = 24, 15  # around the globe, and in each, whose mean has less noise and texture
REACH_MM, STEP_MM = 2.0, 0.1  # to either side of the rim
EDGE = 4  # steps over which an edge is measured
MIN_RATIO = 4.0  # of the edge at the rim to that elsewhere


class VisibleGlobe:
    """The registered rim of one eye.

    Args:
        eye: The eye's geometry.
    """

    def __init__(self, eye: EyeGeometry) -> None:
        steps = round(REACH_MM / STEP_MM)
        radius_px = eye.inner_px + STEP_MM * eye.px_per_mm * np.arange(-steps, steps + 1)
        self._positions_px, in_view = eye.rays(radius_px, SECTORS * RAYS)
        self._in_view = in_view.reshape(SECTORS, RAYS).all(axis=1)
        off_mm = np.abs(STEP_MM * (np.arange(2 * steps + 1 - EDGE) - steps + EDGE / 2))
        self._is_rim = off_mm <= RIM_MISS_MM

    def __call__(self, image: Image) -> bool:
        """Return whether an image shows it; also if its rim is out of view, so that nobody can tell.

        Args:
            image: (h, w, 3) BGR or (h, w) grey.
        """
        if not self._in_view.any():
            return True
        polar = cv2.remap(grey_of(image), *self._positions_px, cv2.INTER_LINEAR)
        mean = polar.reshape(SECTORS, RAYS, -1).mean(axis=1)[self._in_view]
        edge = np.abs(mean[:, EDGE:] - mean[:, :-EDGE]).mean(axis=0)
        return bool(edge[self._is_rim].max() > MIN_RATIO * np.median(edge[~self._is_rim]))
