"""What every registration has: the size and geometry of its images, and the text it was read from.

What it says of the anatomy depends on its kind: an eye before a camera (`registration`), or a B-scan
(`scan_registration`), whose anatomy is found anew in every image.
"""

import hashlib

import numpy as np
from msgspec import Struct

from haptigraph.errors import BadInput
from haptigraph.geometry import Geometry, ImageGeometry, norm
from haptigraph.messages import Image

__all__ = ["VIEW_MARGIN", "Registered"]

VIEW_MARGIN = 1.03
"""Half the side of a picture over the radius of what it shows."""


class Registered(Struct, frozen=True):
    """One set-up."""

    width_px: int
    height_px: int
    image: ImageGeometry
    text: str
    """The file as read; recordings keep it."""

    @property
    def sha256(self) -> str:
        """Fingerprint of the file's text."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @property
    def anatomy(self) -> dict[str, Geometry]:
        """What is known beforehand, by entity name, eye frame."""
        return {}

    @property
    def frontal(self) -> "Registered":
        """The same for images without slant."""
        return self

    @property
    def view_half_mm(self) -> float:
        """From the middle of the eye frame to the edge of a square picture of the whole image."""
        return VIEW_MARGIN * norm(self.image.to_mm((0.0, 0.0)))

    def checked(self, image: Image | None) -> Image:
        """Return an image if it is of the registered size, of 8 bits, grey or BGR.

        Raises:
            BadInput: If not.
        """
        if image is None or image.shape[:2] != (self.height_px, self.width_px):
            found = "no image" if image is None else f"{image.shape[1]} x {image.shape[0]} px"
            raise BadInput(
                f"image is {found}, but the registration is for {self.width_px} x {self.height_px} px"
            )
        if image.dtype != np.uint8 or image.shape[2:] not in ((), (3,)):
            found = f"{image.dtype} values in {' x '.join(map(str, image.shape))}"
            raise BadInput(f"expected an image of 8 bits, grey or BGR, found {found}")
        return image
