"""The simulated membrane: a stained film on the retina, with an edge that curls up and can be peeled.

It does not stretch: pulling the edge further than the loose part reaches detaches more of it from the retina.
A released edge stays where it is. Forces are not modelled.
"""

import math
from typing import Annotated

import cv2
import numpy as np
from msgspec import Meta, Struct
from numpy.typing import NDArray

from haptigraph.geometry import Vec, norm, subtract
from haptigraph.imaging import FloatImage
from haptigraph.messages import Image
from haptigraph.projection import ImageGeometry
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.needle import blurred, clipped_box

__all__ = ["Membrane", "MembraneShape"]

STAIN = (176.0, 108.0, 34.0)  # blue, as brilliant blue G stains the inner limiting membrane
OPACITY = 0.8
STEP_DEG = 0.25
SAG = 0.25  # as a share of a slack flap's length
SHIFT = 4  # sub-pixel bits


class MembraneShape(Struct, frozen=True, forbid_unknown_fields=True):
    """The [membrane] table of a scenario; angles from the bottom, along the retina."""

    edge_deg: Annotated[float, Meta(ge=-75, le=75)] = 4.0
    """Where the loose part initially leaves the retina."""
    end_deg: Annotated[float, Meta(ge=-75, le=75)] = -16.0
    """The end on the other side."""
    flap_mm: Annotated[float, Meta(ge=0.2, le=5)] = 1.3
    """Length of the loose part, which stands up."""
    thickness_mm: Annotated[float, Meta(ge=0.02, le=1)] = 0.22


class Membrane:
    """One membrane.

    Args:
        shape: Its dimensions.
        eye: The eye whose retina it covers.
    """

    def __init__(self, shape: MembraneShape, eye: Eye) -> None:
        self._shape, self._eye = shape, eye
        self._step_deg = math.copysign(STEP_DEG, shape.end_deg - shape.edge_deg)
        self.restart()

    def restart(self) -> None:
        """Return to the initial position."""
        self._front_deg = self._shape.edge_deg
        self._flap_mm = self._shape.flap_mm
        self.edge_mm = self._eye.on_retina(self._front_deg, self._flap_mm)
        """Position of the loose end, eye frame."""

    def pull(self, to_mm: Vec) -> None:
        """Move the loose end to a point, detaching as much from the retina as necessary."""
        self.edge_mm = to_mm
        peeled_mm = self._eye.radius_mm * math.radians(STEP_DEG)
        while norm(subtract(to_mm, self._front_mm())) > self._flap_mm and self._is_attached():
            self._front_deg += self._step_deg
            self._flap_mm += peeled_mm

    def draw(self, image: Image, geometry: ImageGeometry, light: FloatImage, blur_px: float) -> None:
        """Draw it into an image, in place.

        Args:
            image: (h, w, 3).
            geometry: Geometry of the image.
            light: Light that reaches each pixel, (h, w).
            blur_px: Standard deviation of the lens blur.
        """
        path_px = np.array([geometry.to_px(point) for point in self._path_mm()])
        thick_px = max(1, round(self._shape.thickness_mm / geometry.mm_per_px))
        margin = thick_px + 4
        (left, top), (right, bottom) = path_px.min(axis=0) - margin, path_px.max(axis=0) + margin - 1
        box = clipped_box(left, top, right, bottom, image.shape)
        if box is None:
            return
        rows, columns = box
        cover = np.zeros(image[box].shape[:2], np.uint8)
        corners = np.rint((path_px - (columns.start, rows.start)) * 2**SHIFT).astype(np.int32)
        cv2.polylines(cover, [corners], False, 255, thick_px, cv2.LINE_AA, SHIFT)
        share = OPACITY * blurred(cover.astype(np.float32) / np.float32(255), blur_px)[..., None]
        stained = np.array(STAIN, np.float32) * light[box][..., None]
        image[box] = np.clip(np.rint(image[box] * (1 - share) + stained * share), 0, 255).astype(np.uint8)

    def _front_mm(self) -> Vec:
        return self._eye.on_retina(self._front_deg)

    def _is_attached(self) -> bool:
        return (self._shape.end_deg - self._front_deg) * self._step_deg > 0

    def _path_mm(self) -> NDArray[np.float64]:
        """Return its path from the far end along the retina and up to the loose end, (n, 2)."""
        attached_deg = np.arange(self._shape.end_deg, self._front_deg, -self._step_deg)
        above_mm = self._shape.thickness_mm / 2
        attached = [self._eye.on_retina(float(angle), above_mm) for angle in attached_deg]
        start, end = np.array(self._eye.on_retina(self._front_deg, above_mm)), np.array(self.edge_mm)
        slack = max(0.0, 1 - float(np.hypot(*(end - start))) / self._flap_mm)
        along = np.linspace(0, 1, 12)[:, None]
        outwards = start / np.hypot(*start)
        sag = outwards * (SAG * self._flap_mm * slack) * 4 * along * (1 - along)
        return np.concatenate([np.array(attached).reshape(-1, 2), start + (end - start) * along + sag])
