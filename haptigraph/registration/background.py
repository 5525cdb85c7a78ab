"""The empty eye as it was seen when it was registered, part of a registration.

Turns a picture and which of its pixels are known into the few bytes that a file keeps, and back. Knows no
needle.
"""

import cv2
import numpy as np
from msgspec import Struct

from haptigraph.geometry import Homography
from haptigraph.imaging import Mask, tilt_corrected
from haptigraph.messages import Image

__all__ = ["BackgroundImage"]

QUALITY = 90  # of WebP's 100; which pixels are known it keeps exactly


class BackgroundImage(Struct, frozen=True, eq=False):
    """An eye without needle, as the camera takes it."""

    image: Image
    """(h, w, 3) BGR."""
    is_known: Mask
    """Where no needle ever hid it, (h, w)."""

    @classmethod
    def of_webp(cls, data: bytes) -> "BackgroundImage | None":
        """Return what `webp` wrote, None if that is not what it is."""
        read = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
        if read is None or read.ndim != 3 or read.dtype != np.uint8:
            return None
        image = np.asarray(read, np.uint8)
        if image.shape[2] == 3:  # nothing of it was hidden
            return cls(image, np.ones(image.shape[:2], np.bool_))
        return cls(image[..., :3], image[..., 3] > 0)

    @property
    def webp(self) -> bytes:
        """The picture as WebP with transparent holes."""
        alpha = np.where(self.is_known, 255, 0).astype(np.uint8)
        whole = np.dstack([self.image * self.is_known[..., None], alpha])
        return cv2.imencode(".webp", whole, [cv2.IMWRITE_WEBP_QUALITY, QUALITY])[1].tobytes()

    def tilt_corrected(self, frontal_from_image: Homography) -> "BackgroundImage":
        """Return the same for a camera that looks straight at the section."""
        known = tilt_corrected(self.is_known.astype(np.uint8) * 255, frontal_from_image) == 255
        return BackgroundImage(tilt_corrected(self.image, frontal_from_image), known)
