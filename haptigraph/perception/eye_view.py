"""The displayed view, "iOCT-fied" as in the paper (section II-B): the eye cropped, zoomed, grey, un-mirrored.

For people only; perception does not use it.
"""

import cv2
import numpy as np

from haptigraph.geometry import Vec
from haptigraph.imaging import grey_of, tilt_corrected
from haptigraph.messages import Image
from haptigraph.registration.camera import Registration
from haptigraph.registration.registered import VIEW_MARGIN, BaseRegistration

__all__ = ["IoctView"]


class IoctView:
    """Crop the eye from images of one registration.

    Args:
        registration: The globe; of a B-scan, all is shown, in true proportions.
        size_px: Side of the square view.
    """

    def __init__(self, registration: BaseRegistration, size_px: int = 480) -> None:
        self.size_px = size_px
        self.half_mm = registration.view_half_mm
        """From the view's middle to its edge, eye frame."""
        corners_mm = [self.to_mm(corner) for corner in ((0, 0), (size_px, 0), (0, size_px))]
        self._image_from_view = cv2.getAffineTransform(
            np.array(((0, 0), (size_px, 0), (0, size_px)), np.float32),
            np.array([registration.frontal.image.to_px(corner) for corner in corners_mm], np.float32),
        )
        self._tilt = registration.image.frontal_from_image
        y, x = np.ogrid[:size_px, :size_px]
        center = (size_px - 1) / 2
        radius = size_px / 2 / VIEW_MARGIN if isinstance(registration, Registration) else size_px
        self._outside = np.hypot(x - center, y - center) > radius

    def __call__(self, image: Image) -> Image:
        """Return the view, (size, size) grey."""
        grey = grey_of(image)
        view = cv2.warpAffine(
            tilt_corrected(grey, self._tilt) if self._tilt else grey,
            self._image_from_view,
            (self.size_px, self.size_px),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        )
        view[self._outside] = 0
        return np.asarray(view, np.uint8)

    def to_px(self, at_mm: Vec) -> Vec:
        """Turn an eye-frame position [mm] into pixels of the view."""
        scale = self.size_px / (2 * self.half_mm)
        return (
            (at_mm[0] + self.half_mm) * scale - 0.5,
            (self.half_mm - at_mm[1]) * scale - 0.5,
        )

    def to_mm(self, at_px: Vec) -> Vec:
        """Turn pixels of the view into an eye-frame position [mm]."""
        scale = 2 * self.half_mm / self.size_px
        return (at_px[0] + 0.5) * scale - self.half_mm, self.half_mm - (at_px[1] + 0.5) * scale
