"""The cannula: the metal tube of a trocar, in front of the needle that passes through it.

The tube turns with the needle about the remote centre of motion (RCM) while the needle is in it, and rests
perpendicular to the wall otherwise. It casts no shadow.
"""

import math
from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta, Struct

from haptigraph.geometry import Vec, norm, subtract, unit
from haptigraph.imaging import FloatImage
from haptigraph.projection import ImageGeometry
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.needle import (
    Box,
    NeedleShape,
    clipped_box,
    needle_texture,
    relative_box,
    warp_texture,
)

__all__ = ["Cannula", "CannulaShape", "is_in_cannula"]

HEAD_MM, HEAD_DIAMETER_MM = 0.8, 1.8  # the disc outside the wall that keeps the tube in place
SQUARE_END_MM = 0.01  # length of the taper of an end that is cut square
OFF_AXIS_MM = 1.0  # a needle farther than this from the RCM does not pass through the tube


class CannulaShape(Struct, frozen=True, forbid_unknown_fields=True):
    """The [cannula] table of a scenario."""

    diameter_mm: Annotated[float, Meta(ge=0.2, le=3)] = 0.8
    """Outer diameter; that of 23 G to 27 G systems is 0.6 to 0.9 mm."""
    reach_mm: Annotated[float, Meta(ge=0, le=6)] = 1.5
    """Length inside the eye, from the wall's inner surface."""
    brightness: Annotated[float, Meta(ge=0, le=1)] = 0.5
    highlight: Annotated[float, Meta(ge=0, le=1)] = 0.3


def is_in_cannula(shape: CannulaShape, eye: Eye, depth_mm: float) -> bool:
    """Return whether a tip at a depth, measured from the RCM, is inside the tube."""
    outer_mm, inner_mm = _ends_mm(shape, eye)
    return outer_mm <= depth_mm <= inner_mm


def _ends_mm(shape: CannulaShape, eye: Eye) -> tuple[float, float]:
    """Return the depths of the tube's ends, outside (negative) and inside, measured from the RCM."""
    half_wall_mm = eye.shape.wall_mm / 2
    return -half_wall_mm - HEAD_MM, half_wall_mm + shape.reach_mm


class Cannula:
    """The cannula in the trocar in use.

    Args:
        shape: Its shape and brightness.
        eye: The eye.
        geometry: Geometry of the frontal image.
        blur_px: Standard deviation of the lens blur.
        seed: Seed of the metal's grain.
    """

    def __init__(
        self, shape: CannulaShape, eye: Eye, geometry: ImageGeometry, blur_px: float, seed: int
    ) -> None:
        self._rcm_mm, self._geometry = eye.trocar_mm, geometry
        half_wall_mm = eye.shape.wall_mm / 2
        self._outer_mm, self._inner_mm = _ends_mm(shape, eye)
        self._parts = (
            (self._inner_mm, shape.diameter_mm, self._inner_mm + half_wall_mm),
            (-half_wall_mm, HEAD_DIAMETER_MM, HEAD_MM),
        )
        self._textures = [
            needle_texture(
                NeedleShape(
                    diameter_mm=diameter_mm,
                    tip_diameter_mm=diameter_mm,
                    taper_mm=SQUARE_END_MM,
                    length_mm=length_mm,
                    brightness=shape.brightness,
                    highlight=shape.highlight,
                ),
                1 / geometry.mm_per_px,
                blur_px,
                seed + 2,
            )
            for _, diameter_mm, length_mm in self._parts
        ]

    def box(self, size: tuple[int, ...]) -> Box | None:
        """Return the part of an image of (height, width) that the tube can cover in any direction."""
        x, y = self._geometry.to_px(self._rcm_mm)
        reach_px = (
            math.hypot(max(self._inner_mm, -self._outer_mm), HEAD_DIAMETER_MM) / self._geometry.mm_per_px
        )
        return clipped_box(x - reach_px, y - reach_px, x + reach_px, y + reach_px, size)

    def draw(
        self, scene: FloatImage, box: Box, needle: tuple[Vec, Vec], light: FloatImage, in_view: FloatImage
    ) -> None:
        """Draw the tube into a part of the scene, in place, in front of everything.

        Args:
            scene: The part, (h, w, 3).
            box: Its position in the image.
            needle: The needle's tip [mm] and direction (length 1), eye frame.
            light: Light that reaches each pixel of the image, (height, width).
            in_view: Where instruments are visible, 0 to 1, (height, width).
        """
        own = self.box(light.shape)
        if own is None:
            return
        part = relative_box(own, box)
        direction = self._direction(*needle)
        along = -direction[0] if self._geometry.mirrored else direction[0], -direction[1]
        for (end_mm, _, _), (tone, cover) in zip(self._parts, self._textures, strict=True):
            x, y = self._rcm_mm
            end_px = self._geometry.to_px((x + end_mm * direction[0], y + end_mm * direction[1]))
            over = warp_texture(cover, end_px, along, own) * in_view[own]
            color = cv2.merge([warp_texture(tone, end_px, along, own) * light[own]] * 3)
            beneath = np.ascontiguousarray(scene[part])
            scene[part] = cv2.blendLinear(color, beneath, over, 1 - over)

    def _direction(self, tip_mm: Vec, direction: Vec) -> Vec:
        """Return where the tube points: along a needle inside it, else perpendicular to the wall."""
        offset = subtract(tip_mm, self._rcm_mm)
        depth_mm = offset[0] * direction[0] + offset[1] * direction[1]
        beside_mm = norm(subtract(offset, (depth_mm * direction[0], depth_mm * direction[1])))
        if depth_mm > self._outer_mm and beside_mm < OFF_AXIS_MM:
            return direction
        return unit((-self._rcm_mm[0], -self._rcm_mm[1]))
