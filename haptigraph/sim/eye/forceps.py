"""Simulated forceps: two straight jaws at the end of a shaft, which open and close about a hinge.

Turns tip, direction and opening into the positions of the jaws, and draws them. The shaft is the scenario's
needle.
"""

import math
from typing import Annotated, NamedTuple

import cv2
import numpy as np
from msgspec import Meta, Struct

from haptigraph.geometry import Vec, rotate, subtract, unit
from haptigraph.imaging import FloatImage
from haptigraph.messages import Image
from haptigraph.projection import ImageGeometry
from haptigraph.sim.eye.needle import NeedleShape, clipped_box, needle_texture, warp_texture

__all__ = ["Forceps", "ForcepsShape", "Instrument", "JawPositions"]

CLOSED_MM = 0.14  # between the centre lines of the jaws when they touch
MARGIN_PX = 12


class ForcepsShape(Struct, frozen=True, forbid_unknown_fields=True):
    """The [forceps] table of a scenario; the shaft is its [needle]."""

    jaw_mm: Annotated[float, Meta(ge=0.5, le=6)] = 2.6
    """Length of the jaws, from the hinge."""
    jaw_width_mm: Annotated[float, Meta(ge=0.05, le=1)] = 0.26
    brightness: Annotated[float, Meta(ge=0, le=1)] = 0.4


class JawPositions(NamedTuple):
    """Position of forceps, eye frame [mm]."""

    hinge_mm: Vec
    left_mm: Vec
    """Tip of the jaw on the left, as seen along the shaft into the eye."""
    right_mm: Vec


class Instrument:
    """A straight instrument that can be drawn into an image at any pose.

    Args:
        shape: Its shape.
        geometry: Geometry of the image.
        blur_px: Standard deviation of the lens blur.
        seed: Seed of the metal's grain.
    """

    def __init__(self, shape: NeedleShape, geometry: ImageGeometry, blur_px: float, seed: int) -> None:
        self._geometry, self._length_mm = geometry, shape.length_mm
        self._tone, self._cover = needle_texture(shape, 1 / geometry.mm_per_px, blur_px, seed)

    def draw(self, image: Image, tip_mm: Vec, direction: Vec, light: FloatImage, in_view: FloatImage) -> None:
        """Draw it into an image, in place.

        Args:
            image: (h, w, 3).
            tip_mm: Its tip, eye frame.
            direction: From its other end to its tip, length 1, eye frame.
            light: Light that reaches each pixel, (h, w).
            in_view: Where instruments are visible, 0 to 1, (h, w).
        """
        back_mm = tip_mm[0] - self._length_mm * direction[0], tip_mm[1] - self._length_mm * direction[1]
        tip_px, back_px = self._geometry.to_px(tip_mm), self._geometry.to_px(back_mm)
        (left, right), (top, bottom) = (sorted(pair) for pair in zip(tip_px, back_px, strict=True))
        box = clipped_box(
            left - MARGIN_PX, top - MARGIN_PX, right + MARGIN_PX - 1, bottom + MARGIN_PX - 1, image.shape
        )
        if box is None:
            return
        along = unit(subtract(tip_px, back_px))
        over = warp_texture(self._cover, tip_px, along, box) * in_view[box]
        color = cv2.merge([warp_texture(self._tone, tip_px, along, box) * light[box]] * 3)
        image[box] = np.rint(cv2.blendLinear(color, image[box].astype(np.float32), over, 1 - over))


class Forceps:
    """Forceps as drawn into images.

    Args:
        shape: Shape of the jaws.
        geometry: Geometry of the image.
        blur_px: Standard deviation of the lens blur.
        seed: Seed of the metal's grain.
    """

    def __init__(self, shape: ForcepsShape, geometry: ImageGeometry, blur_px: float, seed: int) -> None:
        self._jaw_mm = shape.jaw_mm
        jaw = NeedleShape(
            diameter_mm=shape.jaw_width_mm,
            tip_diameter_mm=shape.jaw_width_mm / 2,
            taper_mm=shape.jaw_mm / 2,
            length_mm=shape.jaw_mm + shape.jaw_width_mm,
            brightness=shape.brightness,
        )
        self._jaw = Instrument(jaw, geometry, blur_px, seed)

    def positions(self, tip_mm: Vec, direction: Vec, opening_mm: float) -> JawPositions:
        """Return the positions of hinge and jaws.

        Args:
            tip_mm: Midpoint between the tips of the jaws, eye frame.
            direction: Direction of the shaft into the eye, length 1, eye frame.
            opening_mm: Distance between the tips; limited by touching jaws and by 90 degrees for each jaw.
        """
        half_mm = min(max(opening_mm, CLOSED_MM) / 2, self._jaw_mm)
        reach_mm = math.sqrt(self._jaw_mm**2 - half_mm**2)
        left = rotate(direction, 90)
        return JawPositions(
            (tip_mm[0] - reach_mm * direction[0], tip_mm[1] - reach_mm * direction[1]),
            (tip_mm[0] + half_mm * left[0], tip_mm[1] + half_mm * left[1]),
            (tip_mm[0] - half_mm * left[0], tip_mm[1] - half_mm * left[1]),
        )

    def draw(self, image: Image, at: JawPositions, light: FloatImage, in_view: FloatImage) -> None:
        """Draw both jaws into an image, in place; see `Instrument.draw`."""
        for tip_mm in (at.left_mm, at.right_mm):
            self._jaw.draw(image, tip_mm, unit(subtract(tip_mm, at.hinge_mm)), light, in_view)
