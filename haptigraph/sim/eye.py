"""The simulated eye: a 24 mm globe cut open, its retina, target and trocars, in the eye frame.

Written as a registration too, so that perception meets it as it meets any other set-up.
"""

import math

from msgspec import Struct

from haptigraph.geometry import ImageGeometry, Vec
from haptigraph.registration_text import AnatomyPx, TrocarPx
from haptigraph.registration_text import registration_text as write_text

__all__ = ["Eye", "EyeShape", "registration_text"]

RETINA_STEP_DEG = 1.5


class EyeShape(Struct, frozen=True, forbid_unknown_fields=True):
    """The [eye] table of a scenario. Angles are at the globe's centre, positive to the surgeon's right."""

    diameter_mm: float = 24.0
    wall_mm: float = 1.7
    retina_half_deg: float = 75.0
    """The retina reaches so far to either side of the bottom."""
    target_deg: float = 9.0
    """From the bottom, along the retina."""
    trocar_deg: float = 36.0
    """From the top: the trocar in use; the other one sits opposite."""


class Eye:
    """Places of one eye [mm], eye frame.

    Args:
        shape: Its measures.
    """

    def __init__(self, shape: EyeShape) -> None:
        self.shape = shape
        self.radius_mm = shape.diameter_mm / 2
        self.target_mm = self._from_bottom(shape.target_deg)
        self.trocar_mm = self._in_wall(shape.trocar_deg)
        self.other_trocar_mm = self._in_wall(-shape.trocar_deg)
        steps = round(2 * shape.retina_half_deg / RETINA_STEP_DEG)
        self.retina_mm = tuple(
            self._from_bottom(shape.retina_half_deg * (2 * step / steps - 1)) for step in range(steps + 1)
        )

    def _from_bottom(self, angle_deg: float) -> Vec:
        angle = math.radians(angle_deg)
        return self.radius_mm * math.sin(angle), -self.radius_mm * math.cos(angle)

    def _in_wall(self, angle_deg: float) -> Vec:
        """Return the middle of the wall, where a trocar lets the needle pivot."""
        angle, radius = math.radians(angle_deg), self.radius_mm + self.shape.wall_mm / 2
        return radius * math.sin(angle), radius * math.cos(angle)


def registration_text(eye: Eye, image: ImageGeometry, width_px: int, height_px: int) -> str:
    """Write the registration of an eye seen through a camera, as TOML."""
    return write_text(
        AnatomyPx(
            width_px=width_px,
            height_px=height_px,
            mirrored=image.mirrored,
            center_px=image.to_px((0.0, 0.0)),
            radius_px=eye.radius_mm / image.mm_per_px,
            diameter_mm=eye.shape.diameter_mm,
            contour_px=tuple(image.to_px(point) for point in eye.retina_mm),
            target_px=image.to_px(eye.target_mm),
            trocars=(
                TrocarPx("first", image.to_px(eye.trocar_mm), used=True),
                TrocarPx("second", image.to_px(eye.other_trocar_mm), used=False),
            ),
        ),
        "Registration of a simulated eye.",
    )
