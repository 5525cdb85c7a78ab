"""The simulated membrane: a stained film on the retina, with an edge that curls up and can be peeled.

It does not stretch: where the edge is pulled further than the loose part reaches, more of it comes off the
retina. What was let go stays where it is. Knows no forceps but where it pulls, and no force.
"""

import math
from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from haptigraph.geometry import ImageGeometry, Vec, norm, subtract
from haptigraph.messages import Image
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.needle import blurred
from haptigraph.sim.eye.painter import FloatImage

__all__ = ["Membrane", "MembraneShape"]

STAIN = (176.0, 108.0, 34.0)  # blue, as brilliant blue G stains the inner limiting membrane
OPACITY = 0.8
STEP_DEG = 0.25
SAG = 0.25  # of a slack flap's length
SHIFT = 4  # bits of sub-pixel


class MembraneShape(Struct, frozen=True, forbid_unknown_fields=True):
    """The [membrane] table of a scenario. Angles are from the bottom, along the retina."""

    edge_deg: Annotated[float, Meta(ge=-75, le=75)] = 4.0
    """Where its loose part leaves the retina before anyone pulls."""
    end_deg: Annotated[float, Meta(ge=-75, le=75)] = -16.0
    """Where it ends on the other side."""
    flap_mm: Annotated[float, Meta(ge=0.2, le=5)] = 1.3
    """Length of the loose part; it stands up."""
    thickness_mm: Annotated[float, Meta(ge=0.02, le=1)] = 0.22


class Membrane:
    """One membrane.

    Args:
        shape: Its measures.
        eye: Whose retina it lies on.
    """

    def __init__(self, shape: MembraneShape, eye: Eye) -> None:
        self._shape, self._eye = shape, eye
        self._step_deg = math.copysign(STEP_DEG, shape.end_deg - shape.edge_deg)
        self.restart()

    def restart(self) -> None:
        """Lie as before anyone pulled."""
        self._front_deg = self._shape.edge_deg
        self._flap_mm = self._shape.flap_mm
        self.edge_mm = self._eye.on_retina(self._front_deg, self._flap_mm)
        """Where the loose end is, eye frame."""

    def pull(self, to_mm: Vec) -> None:
        """Bring the loose end to a place; come off the retina as far as that needs."""
        self.edge_mm = to_mm
        peeled_mm = self._eye.radius_mm * math.radians(STEP_DEG)
        while norm(subtract(to_mm, self._front_mm())) > self._flap_mm and self._is_held():
            self._front_deg += self._step_deg
            self._flap_mm += peeled_mm

    def draw(self, image: Image, geometry: ImageGeometry, light: FloatImage, blur_px: float) -> None:
        """Draw it into a picture, in place.

        Args:
            image: (h, w, 3).
            geometry: Of the picture.
            light: That reaches each pixel, (h, w).
            blur_px: Deviation of the lens's blur.
        """
        places = np.array([geometry.to_px(place) for place in self._course_mm()])
        thick_px = max(1, round(self._shape.thickness_mm / geometry.mm_per_px))
        margin = thick_px + 4
        left, top = np.maximum(np.floor(places.min(axis=0)).astype(int) - margin, 0)
        right, bottom = np.ceil(places.max(axis=0)).astype(int) + margin
        box = slice(top, bottom), slice(left, right)
        cover = np.zeros(image[box].shape[:2], np.uint8)
        corners = np.rint((places - (left, top)) * 2**SHIFT).astype(np.int32)
        cv2.polylines(cover, [corners], False, 255, thick_px, cv2.LINE_AA, SHIFT)
        share = OPACITY * blurred(cover.astype(np.float32) / np.float32(255), blur_px)[..., None]
        stained = np.array(STAIN, np.float32) * light[box][..., None]
        image[box] = np.clip(np.rint(image[box] * (1 - share) + stained * share), 0, 255).astype(np.uint8)

    def _front_mm(self) -> Vec:
        return self._eye.on_retina(self._front_deg)

    def _is_held(self) -> bool:
        return (self._shape.end_deg - self._front_deg) * self._step_deg > 0

    def _course_mm(self) -> NDArray[np.float64]:
        """Return its course from the far end along the retina and up to the loose end, (n, 2)."""
        lies = np.arange(self._shape.end_deg, self._front_deg, -self._step_deg)
        above_mm = self._shape.thickness_mm / 2
        attached = [self._eye.on_retina(float(angle), above_mm) for angle in lies]
        start, end = np.array(self._eye.on_retina(self._front_deg, above_mm)), np.array(self.edge_mm)
        slack = max(0.0, 1 - float(np.hypot(*(end - start))) / self._flap_mm)
        along = np.linspace(0, 1, 12)[:, None]
        outwards = start / np.hypot(*start)
        sag = outwards * (SAG * self._flap_mm * slack) * 4 * along * (1 - along)
        return np.concatenate([np.array(attached).reshape(-1, 2), start + (end - start) * along + sag])
