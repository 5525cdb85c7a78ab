"""Reference image without instrument, part of a registration: encode it with its mask as WebP, and back."""

import cv2
import numpy as np
from msgspec import Struct

from haptigraph.imaging import Mask, tilt_corrected
from haptigraph.messages import Image
from haptigraph.projection import ImageMap

__all__ = ["BackgroundImage"]

WEBP_QUALITY = 90  # of 100; the alpha channel, which holds the mask, stays lossless


class BackgroundImage(Struct, frozen=True, eq=False):
    """The eye without instrument, as the camera images it."""

    image: Image
    """(h, w, 3) BGR."""
    is_known: Mask
    """Where the eye was visible without the instrument, (h, w)."""

    @classmethod
    def of_webp(cls, data: bytes) -> "BackgroundImage | None":
        """Decode what `webp` encoded; None if the bytes are no colour image."""
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
        if decoded is None or decoded.ndim != 3 or decoded.dtype != np.uint8:
            return None
        image = np.asarray(decoded, np.uint8)
        if image.shape[2] == 3:  # no transparent pixels: nothing is occluded
            return cls(image, np.ones(image.shape[:2], np.bool_))
        return cls(image[..., :3], image[..., 3] > 0)

    @property
    def webp(self) -> bytes:
        """The image as WebP, transparent where it is not known."""
        alpha = np.where(self.is_known, 255, 0).astype(np.uint8)
        bgra = np.dstack([self.image * self.is_known[..., None], alpha])
        return cv2.imencode(".webp", bgra, [cv2.IMWRITE_WEBP_QUALITY, WEBP_QUALITY])[1].tobytes()

    def tilt_corrected(self, frontal_from_image: ImageMap) -> "BackgroundImage":
        """Return the background image in the frontal view."""
        known = tilt_corrected(self.is_known.astype(np.uint8) * 255, frontal_from_image) == 255
        return BackgroundImage(tilt_corrected(self.image, frontal_from_image), known)
