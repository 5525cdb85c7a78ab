"""The retina of the camera phantom where it is a layer that gives: where it is, and how that looks.

Turns the needle's tip (eye frame, mm) into a dent along the retina, by the law of `tissue`, and bends the
picture of what stands still to it. The wall behind the layer stays where it is. Knows no needle but its tip.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.geometry import ImageGeometry, Polyline, Vec, norm
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.needle import Box
from haptigraph.sim.eye.painter import FloatImage
from haptigraph.sim.tissue import Dent, TissueShape

__all__ = ["MOST_SHARE", "SoftRetina"]

MOST_SHARE = 0.9
"""Of the layer, that a tip can press in: below that is the wall."""
STEP_MM = 0.02
TOLD_EVERY, TOLD_MM = 3, 0.005  # a dent less deep is told as coarsely as the registration does
SEEN_PX = 0.05
BEFORE_SHARE = 2.0  # of the layer's thickness: what lies so far before it is stretched


class SoftRetina:
    """One retina.

    Args:
        shape: How it gives.
        eye: Whose retina it is; the layer must have a thickness.
    """

    def __init__(self, shape: TissueShape, eye: Eye) -> None:
        self._eye = eye
        self._rest_mm = eye.radius_mm - eye.shape.retina_mm
        half = math.radians(eye.shape.retina_half_deg)
        coarse = len(eye.retina_mm) - 1
        finer = math.ceil(2 * half * self._rest_mm / coarse / STEP_MM)
        self._turns = np.linspace(-half, half, coarse * finer + 1)  # from the bottom, the right is positive
        self._is_coarse, self._is_finer = (
            np.arange(len(self._turns)) % every == 0 for every in (finer, TOLD_EVERY)
        )
        self._dent = Dent(shape, self._turns * self._rest_mm)
        self.restart()

    def restart(self) -> None:
        """Lie at rest."""
        self._dent.restart()
        self._dent_mm = np.zeros_like(self._turns)

    def advance(self, elapsed_s: float, tip_mm: Vec | None) -> None:
        """Move on to a moment.

        Args:
            elapsed_s: Since the moment before.
            tip_mm: The needle's tip then, eye frame; None: it is out of the picture.
        """
        tip = None
        if tip_mm is not None:
            along_mm = math.atan2(tip_mm[0], -tip_mm[1]) * self._rest_mm
            tip = along_mm, min(norm(tip_mm) - self._rest_mm, MOST_SHARE * self._eye.shape.retina_mm)
        self._dent_mm = self._dent.advance(elapsed_s, tip)

    def surface(self) -> Polyline:
        """Return where it is, in the order of the registered contour, eye frame."""
        told = self._is_coarse | (self._is_finer & (self._dent_mm > TOLD_MM))
        told[self._dent_mm.argmax()] = True  # the deepest place
        radius_mm, turns = self._rest_mm + self._dent_mm[told], self._turns[told]
        x_mm, y_mm = radius_mm * np.sin(turns), -radius_mm * np.cos(turns)
        return Polyline(tuple(zip(x_mm.tolist(), y_mm.tolist(), strict=True)))

    def bend(self, picture: FloatImage, geometry: ImageGeometry) -> tuple[Box, FloatImage] | None:
        """Return the part of a picture that the dent changes, and what it looks like; None if there is none.

        The layer's inner edge moves outwards; the layer is compressed towards the wall, and what lies before
        it is stretched.

        Args:
            picture: Of what stands still, retina at rest, (h, w, 3).
            geometry: Of the picture.
        """
        box = self._bent_box(picture, geometry)
        if box is None:
            return None
        rows, columns = box
        across = np.arange(columns.start, columns.stop) - geometry.center_px[0]
        down = (np.arange(rows.start, rows.stop) - geometry.center_px[1])[:, None]
        right = -across if geometry.mirrored else across
        dent_px = np.interp(np.arctan2(right, down), self._turns, self._dent_mm, 0, 0) / geometry.mm_per_px
        radius_px = np.hypot(across, down)
        share = self._rest_px(radius_px, dent_px, geometry.mm_per_px) / np.maximum(radius_px, 1)
        x, y = geometry.center_px[0] + share * across, geometry.center_px[1] + share * down
        bent = cv2.remap(
            picture, x.astype(np.float32), y.astype(np.float32), cv2.INTER_CUBIC, None, cv2.BORDER_REPLICATE
        )
        return box, np.asarray(bent, np.float32)

    def _rest_px(
        self, radius_px: NDArray[np.float64], dent_px: NDArray[np.float64], mm_per_px: float
    ) -> NDArray[np.float64]:
        """Return how far from the globe's centre that is at rest which is seen somewhere now."""
        edge_px, wall_px = self._rest_mm / mm_per_px, self._eye.radius_mm / mm_per_px
        from_px = edge_px - BEFORE_SHARE * (wall_px - edge_px)
        pressed_px = edge_px + dent_px
        before = from_px + (radius_px - from_px) * (edge_px - from_px) / (pressed_px - from_px)
        within = wall_px + (radius_px - wall_px) * (wall_px - edge_px) / (wall_px - pressed_px)
        rest_px = np.where(radius_px < pressed_px, before, within)
        return np.where((radius_px > from_px) & (radius_px < wall_px), rest_px, radius_px)

    def _bent_box(self, picture: FloatImage, geometry: ImageGeometry) -> Box | None:
        """Return the part of a picture in which something is elsewhere than at rest."""
        turns = self._turns[self._dent_mm > SEEN_PX * geometry.mm_per_px]
        if not len(turns):
            return None
        wall_mm = self._eye.radius_mm
        from_mm = self._rest_mm - BEFORE_SHARE * self._eye.shape.retina_mm
        corners = [
            geometry.to_px((radius_mm * math.sin(turn), -radius_mm * math.cos(turn)))
            for radius_mm in (from_mm, wall_mm)
            for turn in (*turns[:: max(1, len(turns) // 32)].tolist(), turns[-1])
        ]
        x, y = np.array(corners).T
        height, width = picture.shape[:2]
        rows = slice(max(math.floor(y.min()), 0), min(math.ceil(y.max()) + 1, height))
        columns = slice(max(math.floor(x.min()), 0), min(math.ceil(x.max()) + 1, width))
        return (rows, columns) if rows.start < rows.stop and columns.start < columns.stop else None
