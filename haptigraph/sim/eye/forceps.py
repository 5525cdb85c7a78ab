"""Simulated forceps: two straight jaws at the end of a shaft, that open and close about a hinge.

The shaft is the scenario's needle. Turns tip, direction and opening into the places of the jaws, and draws
them. Knows no tissue.
"""

import math
from typing import Annotated, NamedTuple

import cv2
import numpy as np
from msgspec import Meta, Struct

from haptigraph.geometry import ImageGeometry, Vec, rotate, subtract, unit
from haptigraph.messages import Image
from haptigraph.sim.eye.needle import Box, NeedleShape, lay, needle_texture
from haptigraph.sim.eye.painter import FloatImage

__all__ = ["Forceps", "ForcepsShape", "Instrument", "JawPlaces"]

CLOSED_MM = 0.14  # between the jaws' middles when they touch
MARGIN_PX = 12


class ForcepsShape(Struct, frozen=True, forbid_unknown_fields=True):
    """The [forceps] table of a scenario; its shaft is the [needle]."""

    jaw_mm: Annotated[float, Meta(ge=0.5, le=6)] = 2.6
    """Length of the jaws, from the hinge."""
    jaw_width_mm: Annotated[float, Meta(ge=0.05, le=1)] = 0.26
    brightness: Annotated[float, Meta(ge=0, le=1)] = 0.4


class JawPlaces(NamedTuple):
    """Where forceps are, eye frame [mm]."""

    hinge_mm: Vec
    left_mm: Vec
    """Tip of the jaw on the left, as seen along the shaft into the eye."""
    right_mm: Vec


class Instrument:
    """Something straight that can be laid into a picture anywhere.

    Args:
        shape: Its shape.
        geometry: Of the picture.
        blur_px: Deviation of the lens's blur.
        seed: Of the metal's grain.
    """

    def __init__(self, shape: NeedleShape, geometry: ImageGeometry, blur_px: float, seed: int) -> None:
        self._geometry, self._length_mm = geometry, shape.length_mm
        self._tone, self._cover = needle_texture(shape, 1 / geometry.mm_per_px, blur_px, seed)

    def draw(self, image: Image, tip_mm: Vec, direction: Vec, light: FloatImage, in_view: FloatImage) -> None:
        """Draw it into a picture, in place.

        Args:
            image: (h, w, 3).
            tip_mm: Its tip, eye frame.
            direction: From its other end to its tip, length 1, eye frame.
            light: That reaches each pixel, (h, w).
            in_view: Where instruments are seen, 0 to 1, (h, w).
        """
        back_mm = tip_mm[0] - self._length_mm * direction[0], tip_mm[1] - self._length_mm * direction[1]
        tip_px, back_px = self._geometry.to_px(tip_mm), self._geometry.to_px(back_mm)
        box = _box(tip_px, back_px, image.shape)
        if box is None:
            return
        along = unit(subtract(tip_px, back_px))
        over = lay(self._cover, tip_px, along, box) * in_view[box]
        color = cv2.merge([lay(self._tone, tip_px, along, box) * light[box]] * 3)
        image[box] = np.rint(cv2.blendLinear(color, image[box].astype(np.float32), over, 1 - over))


class Forceps:
    """Forceps in one picture.

    Args:
        shape: Of the jaws.
        geometry: Of the picture.
        blur_px: Deviation of the lens's blur.
        seed: Of the metal's grain.
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

    def places(self, tip_mm: Vec, direction: Vec, opening_mm: float) -> JawPlaces:
        """Return where hinge and jaws are.

        Args:
            tip_mm: Middle between the jaws' tips, eye frame.
            direction: Of the shaft into the eye, length 1, eye frame.
            opening_mm: Between the jaws' tips; closed jaws lie side by side, none opens beyond 90 degrees.
        """
        half_mm = min(max(opening_mm, CLOSED_MM) / 2, self._jaw_mm)
        reach_mm = math.sqrt(self._jaw_mm**2 - half_mm**2)
        left = rotate(direction, 90)
        return JawPlaces(
            (tip_mm[0] - reach_mm * direction[0], tip_mm[1] - reach_mm * direction[1]),
            (tip_mm[0] + half_mm * left[0], tip_mm[1] + half_mm * left[1]),
            (tip_mm[0] - half_mm * left[0], tip_mm[1] - half_mm * left[1]),
        )

    def draw(self, image: Image, at: JawPlaces, light: FloatImage, in_view: FloatImage) -> None:
        """Draw both jaws into a picture, in place; see `Instrument.draw`."""
        for tip_mm in (at.left_mm, at.right_mm):
            self._jaw.draw(image, tip_mm, unit(subtract(tip_mm, at.hinge_mm)), light, in_view)


def _box(one_px: Vec, other_px: Vec, size: tuple[int, ...]) -> Box | None:
    """Return the part of a picture about the way between two places; None if it lies beside."""
    (left, right), (top, bottom) = (sorted(pair) for pair in zip(one_px, other_px, strict=True))
    rows = slice(max(math.floor(top) - MARGIN_PX, 0), min(math.ceil(bottom) + MARGIN_PX, size[0]))
    columns = slice(max(math.floor(left) - MARGIN_PX, 0), min(math.ceil(right) + MARGIN_PX, size[1]))
    return (rows, columns) if rows.start < rows.stop and columns.start < columns.stop else None
