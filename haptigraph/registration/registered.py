"""What all registrations share: size and geometry of the images, and the text of the file.

`camera` adds the static anatomy of an eye before a camera; `oct` adds the target of B-scans, whose anatomy
perception finds in every image.
"""

import hashlib
from typing import ClassVar

import numpy as np
from msgspec import Struct

from haptigraph.errors import BadInput
from haptigraph.geometry import Geometry, norm
from haptigraph.imaging import UPRIGHT, Turn
from haptigraph.messages import Image
from haptigraph.projection import ImageGeometry
from haptigraph.registration.depth import DepthPlane

__all__ = ["VIEW_MARGIN", "BaseRegistration"]

VIEW_MARGIN = 1.03
"""Half the side of a square view, relative to the radius of what it shows."""


class BaseRegistration(Struct, frozen=True, kw_only=True):
    """Base class of registrations: one set-up."""

    width_px: int
    height_px: int
    image: ImageGeometry
    text: str
    """The file as read; recordings store it."""
    how_to_state: ClassVar[str] = "register with --target X,Y, or click the target on the registration page"
    """What the user does about an assumed target."""
    turn: Turn = UPRIGHT
    """How the source's images were turned."""
    assumed: tuple[str, ...] = ()
    """What was neither measured nor stated, by name (`registration.assumed`)."""
    depth: DepthPlane | None = None
    """The section in the depth camera's images, if the file says where it is."""

    @property
    def sha256(self) -> str:
        """Fingerprint of the file's text."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @property
    def anatomy(self) -> dict[str, Geometry]:
        """The static entities by name, eye frame."""
        return {}

    @property
    def frontal(self) -> "BaseRegistration":
        """The same registration for tilt-corrected (frontal) images."""
        return self

    @property
    def view_half_mm(self) -> float:
        """Half the side of a square view of the whole image."""
        return VIEW_MARGIN * norm(self.image.to_mm((0.0, 0.0)))

    def check_turn(self, turn: Turn, file: str) -> None:
        """Refuse images that are turned in another way than the registered ones.

        Args:
            turn: How the run's images are turned.
            file: The registration file, for the error.

        Raises:
            BadInput: If they differ.
        """
        if turn != self.turn:
            is_for = f"is for images with {self.turn}, but the run has {turn}"
            raise BadInput(f"{is_for}; set both alike, or register again", file)

    def checked(self, image: Image | None) -> Image:
        """Return an image if it has the registered size and 8 bits, grey or BGR.

        Raises:
            BadInput: If it does not.
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
