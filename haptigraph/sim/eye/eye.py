"""The simulated eye: a 24 mm globe cut open, its retina, target and trocars, in the eye frame.

It is also written as a registration, so that perception handles it like any other set-up.
"""

import math
from typing import Annotated

from msgspec import Meta, Struct

from haptigraph.geometry import Vec, rotate, unit
from haptigraph.projection import ImageGeometry, LensMap
from haptigraph.registration.depth import DepthPlane
from haptigraph.registration.text import AnatomyPx, TrocarPx
from haptigraph.registration.text import registration_text as write_text

__all__ = ["Eye", "EyeShape", "RegistrationError", "registration_text"]

RETINA_STEP_DEG = 1.5


class EyeShape(Struct, frozen=True, forbid_unknown_fields=True):
    """The [eye] table of a scenario; angles at the globe's centre, positive to the surgeon's right."""

    diameter_mm: Annotated[float, Meta(ge=15, le=35)] = 24.0
    wall_mm: Annotated[float, Meta(ge=0.1, le=5)] = 1.7
    retina_half_deg: Annotated[float, Meta(ge=5, le=120)] = 75.0
    """Extent of the retina to either side of the bottom."""
    retina_mm: Annotated[float, Meta(ge=0, le=2)] = 0.0
    """Thickness of the retina as a layer that a tip can enter; 0: it is the wall's inner surface."""
    rim_mm: Annotated[float, Meta(ge=0, le=5)] = 0.0
    """Distance of the cut wall in front of the section that the needle moves in."""
    target_deg: Annotated[float, Meta(ge=-90, le=90)] = 9.0
    """From the bottom, along the retina."""
    trocar_deg: Annotated[float, Meta(ge=-90, le=90)] = 36.0
    """The trocar in use, from the top; the other one is opposite."""
    hemorrhage_deg: Annotated[float, Meta(ge=-90, le=90)] = 0.0
    """Centre of a hemorrhage, from the bottom, along the retina."""
    hemorrhage_mm: Annotated[float, Meta(ge=0, le=6)] = 0.0
    """Width of the hemorrhage; 0: none."""


class RegistrationError(Struct, frozen=True, forbid_unknown_fields=True):
    """The [registration_error] table of a scenario: offsets of the registered anatomy, (x, y) px."""

    globe_px: Vec = (0.0, 0.0)
    """Offset of the globe with its retina."""
    target_px: Vec = (0.0, 0.0)
    trocar_px: Vec = (0.0, 0.0)
    """Offset of both trocars."""


class Eye:
    """Positions of one eye's anatomy [mm], eye frame.

    Args:
        shape: Its dimensions.
    """

    def __init__(self, shape: EyeShape) -> None:
        self.shape = shape
        self.radius_mm = shape.diameter_mm / 2
        self.target_mm = self.on_retina(shape.target_deg)
        self.hemorrhage_mm = self.on_retina(shape.hemorrhage_deg)
        self.trocar_mm = self._in_wall(shape.trocar_deg)
        self.other_trocar_mm = self._in_wall(-shape.trocar_deg)
        steps = round(2 * shape.retina_half_deg / RETINA_STEP_DEG)
        self.retina_mm = tuple(
            self.on_retina(shape.retina_half_deg * (2 * step / steps - 1)) for step in range(steps + 1)
        )

    def on_retina(self, angle_deg: float, above_mm: float = 0.0) -> Vec:
        """Return the point at an angle along the retina from the bottom, at a height above it."""
        angle = math.radians(angle_deg)
        radius_mm = self.radius_mm - self.shape.retina_mm - above_mm
        return radius_mm * math.sin(angle), -radius_mm * math.cos(angle)

    def second_instrument(self, depth_mm: float, pitch_deg: float) -> tuple[Vec, Vec]:
        """Return tip [mm] and direction (length 1) of an instrument through the other trocar; see `Pose`."""
        x, y = self.other_trocar_mm
        along = rotate(unit((-x, -y)), pitch_deg)
        return (x + depth_mm * along[0], y + depth_mm * along[1]), along

    def _in_wall(self, angle_deg: float) -> Vec:
        """Return the middle of the wall, where a trocar's remote centre of motion is."""
        angle, radius = math.radians(angle_deg), self.radius_mm + self.shape.wall_mm / 2
        return radius * math.sin(angle), radius * math.cos(angle)


def registration_text(
    eye: Eye,
    image: ImageGeometry,
    width_px: int,
    height_px: int,
    error: RegistrationError | None = None,
    depth: DepthPlane | None = None,
) -> str:
    """Return the registration of an eye in a camera's images as TOML, offset by an error if one is given."""
    error = error or RegistrationError()
    frontal = image.frontal_from_image
    lens, homography = (frontal.lens, frontal.homography) if isinstance(frontal, LensMap) else (None, frontal)

    def px(at_mm: Vec, off_px: Vec) -> Vec:
        x, y = image.to_px(at_mm)
        return x + off_px[0], y + off_px[1]

    return write_text(
        AnatomyPx(
            width_px=width_px,
            height_px=height_px,
            mirrored=image.mirrored,
            center_px=px((0.0, 0.0), error.globe_px),
            radius_px=eye.radius_mm / image.mm_per_px,
            diameter_mm=eye.shape.diameter_mm,
            contour_px=tuple(px(point, error.globe_px) for point in eye.retina_mm),
            target_px=px(eye.target_mm, error.target_px),
            trocars=(
                TrocarPx("first", px(eye.trocar_mm, error.trocar_px), used=True),
                TrocarPx("second", px(eye.other_trocar_mm, error.trocar_px), used=False),
            ),
            frontal_from_image=homography,
            depth=depth,
            lens=lens,
        ),
        "Registration of a simulated eye.",
    )
