"""Cut depth images to the part around the globe: all that perception reads, and that recordings hold."""

import numpy as np
from msgspec.structs import replace

from haptigraph.messages import Capture, DepthImage
from haptigraph.registration.camera import Registration
from haptigraph.registration.registered import BaseRegistration
from haptigraph.sources.wrapper import SourceWrapper
from haptigraph.stages import Source

__all__ = ["DepthRegionSource", "with_depth_region"]

BEYOND_MM = 8.0  # of the globe: its wall, and the shaft outside


def with_depth_region(source: Source, registration: BaseRegistration) -> Source:
    """Return a source whose depths are cut to the region around the globe; it itself if it has none."""
    if source.depth_camera is None or not isinstance(registration, Registration):
        return source
    return DepthRegionSource(source, registration)


class DepthRegionSource(SourceWrapper):
    """Cut the depths of another source to a square around the globe.

    Args:
        source: The source.
        registration: Has the globe.
    """

    def __init__(self, source: Source, registration: Registration) -> None:
        super().__init__(source)
        center_px = np.array(registration.image.to_px((0.0, 0.0)))
        half_px = (registration.globe.radius_mm + BEYOND_MM) / registration.image.mm_per_px
        self._first = np.floor(center_px - half_px).astype(int)
        self._last = np.ceil(center_px + half_px).astype(int) + 1

    def read(self, timeout_s: float) -> Capture | None:
        """Return the next capture."""
        capture = self._source.read(timeout_s)
        if capture is None or capture.depth is None:
            return capture
        return replace(capture, depth=self._cut(capture.depth))

    def _cut(self, depth: DepthImage) -> DepthImage:
        at = depth.left_px, depth.top_px
        (left, top), (right, bottom) = (
            np.maximum(corner - at, 0).tolist() for corner in (self._first, self._last)
        )
        values = np.ascontiguousarray(depth.values[top:bottom, left:right])
        return DepthImage(values, depth.unit_mm, depth.left_px + left, depth.top_px + top)
