"""The camera phantom's retina as a deformable layer: its surface, and its appearance in the image.

Turns the needle's tip (eye frame, mm) into a dent along the retina (see `tissue`), and warps the static
background accordingly. The wall behind the layer does not move.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.geometry import Polyline, Vec, norm
from haptigraph.imaging import FloatImage
from haptigraph.projection import ImageGeometry
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.needle import Box, clipped_box
from haptigraph.sim.tissue import Dent, TissueShape

__all__ = ["MAX_DENT_SHARE", "SoftRetina"]

MAX_DENT_SHARE = 0.9
"""Largest depth of a dent, as a share of the layer's thickness."""
STEP_MM = 0.02
FINE_EVERY, MIN_FINE_DENT_MM = 3, 0.005  # shallower parts are reported as coarsely as the registered contour
MIN_SHIFT_PX = 0.05
STRETCHED_SHARE = 2.0  # depth of the image stretched in front of the layer, over the layer's thickness


class SoftRetina:
    """One deformable retina.

    Args:
        shape: How it deforms.
        eye: The eye; its retina must be a layer with a thickness.
    """

    def __init__(self, shape: TissueShape, eye: Eye) -> None:
        self._eye = eye
        self._rest_mm = eye.radius_mm - eye.shape.retina_mm
        half = math.radians(eye.shape.retina_half_deg)
        coarse = len(eye.retina_mm) - 1
        substeps = math.ceil(2 * half * self._rest_mm / coarse / STEP_MM)
        # From the bottom, positive to the right.
        self._at_rad = np.linspace(-half, half, coarse * substeps + 1)
        self._is_coarse, self._is_fine = (
            np.arange(len(self._at_rad)) % every == 0 for every in (substeps, FINE_EVERY)
        )
        self._dent = Dent(shape, self._at_rad * self._rest_mm)
        self.restart()

    def restart(self) -> None:
        """Return to the resting surface."""
        self._dent.restart()
        self._dent_mm = np.zeros_like(self._at_rad)

    def advance(self, elapsed_s: float, tip_mm: Vec | None) -> None:
        """Advance in time.

        Args:
            elapsed_s: Time since the last call.
            tip_mm: The needle's tip now, eye frame; None: it is out of view.
        """
        tip = None
        if tip_mm is not None:
            along_mm = math.atan2(tip_mm[0], -tip_mm[1]) * self._rest_mm
            tip = along_mm, min(norm(tip_mm) - self._rest_mm, MAX_DENT_SHARE * self._eye.shape.retina_mm)
        self._dent_mm = self._dent.advance(elapsed_s, tip)

    def surface(self) -> Polyline:
        """Return the surface, in the order of the registered contour, eye frame."""
        is_reported = self._is_coarse | (self._is_fine & (self._dent_mm > MIN_FINE_DENT_MM))
        is_reported[self._dent_mm.argmax()] = True  # the deepest point
        radius_mm, at_rad = self._rest_mm + self._dent_mm[is_reported], self._at_rad[is_reported]
        x_mm, y_mm = radius_mm * np.sin(at_rad), -radius_mm * np.cos(at_rad)
        return Polyline(tuple(zip(x_mm.tolist(), y_mm.tolist(), strict=True)))

    def warp(self, scene: FloatImage, geometry: ImageGeometry) -> tuple[Box, FloatImage] | None:
        """Return the part of an image that the dent changes, with its new content; None if there is none.

        The layer's inner edge moves outwards; the layer is compressed towards the wall, and the image in
        front of it is stretched.

        Args:
            scene: Static background with the retina at rest, (h, w, 3).
            geometry: Geometry of the image.
        """
        box = self._warped_box(scene, geometry)
        if box is None:
            return None
        rows, columns = box
        across = np.arange(columns.start, columns.stop) - geometry.center_px[0]
        down = (np.arange(rows.start, rows.stop) - geometry.center_px[1])[:, None]
        right = -across if geometry.mirrored else across
        dent_px = np.interp(np.arctan2(right, down), self._at_rad, self._dent_mm, 0, 0) / geometry.mm_per_px
        radius_px = np.hypot(across, down)
        share = self._rest_px(radius_px, dent_px, geometry.mm_per_px) / np.maximum(radius_px, 1)
        x, y = geometry.center_px[0] + share * across, geometry.center_px[1] + share * down
        warped = cv2.remap(
            scene, x.astype(np.float32), y.astype(np.float32), cv2.INTER_CUBIC, None, cv2.BORDER_REPLICATE
        )
        return box, np.asarray(warped, np.float32)

    def _rest_px(
        self, radius_px: NDArray[np.float64], dent_px: NDArray[np.float64], mm_per_px: float
    ) -> NDArray[np.float64]:
        """Return the resting distance from the globe's centre of what appears at a distance now."""
        edge_px, wall_px = self._rest_mm / mm_per_px, self._eye.radius_mm / mm_per_px
        from_px = edge_px - STRETCHED_SHARE * (wall_px - edge_px)
        pressed_px = edge_px + dent_px
        before = from_px + (radius_px - from_px) * (edge_px - from_px) / (pressed_px - from_px)
        within = wall_px + (radius_px - wall_px) * (wall_px - edge_px) / (wall_px - pressed_px)
        rest_px = np.where(radius_px < pressed_px, before, within)
        return np.where((radius_px > from_px) & (radius_px < wall_px), rest_px, radius_px)

    def _warped_box(self, scene: FloatImage, geometry: ImageGeometry) -> Box | None:
        """Return the part of an image that differs from the one at rest."""
        at_rad = self._at_rad[self._dent_mm > MIN_SHIFT_PX * geometry.mm_per_px]
        if not len(at_rad):
            return None
        wall_mm = self._eye.radius_mm
        from_mm = self._rest_mm - STRETCHED_SHARE * self._eye.shape.retina_mm
        corners = [
            geometry.to_px((radius_mm * math.sin(angle_rad), -radius_mm * math.cos(angle_rad)))
            for radius_mm in (from_mm, wall_mm)
            for angle_rad in (*at_rad[:: max(1, len(at_rad) // 32)].tolist(), at_rad[-1])
        ]
        x, y = np.array(corners).T
        return clipped_box(x.min(), y.min(), x.max(), y.max(), scene.shape)
