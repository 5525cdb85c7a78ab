"""The simulated camera: render needle and shadow into the painted phantom, then model lens and sensor.

The view is mirrored like the real one. The same pose and image number always give the same pixels.
"""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from haptigraph.geometry import ImageGeometry, Vec, norm, subtract
from haptigraph.imaging import FloatImage
from haptigraph.messages import Image
from haptigraph.sim.eye.distractors import (
    Bubbles,
    Distractors,
    flicker_gain,
    paint_light_pipe,
    paint_specular_highlights,
)
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.needle import (
    Box,
    NeedleShape,
    blurred,
    clipped_box,
    needle_texture,
    relative_box,
    warp_texture,
)
from haptigraph.sim.eye.optics import CameraSettings, image_geometry, slant_of
from haptigraph.sim.eye.painter import distance_map, paint_phantom, rim_geometry, shading_positions, vignette
from haptigraph.sim.eye.palette import Appearance

__all__ = ["Camera", "NeedleShape"]

NOISE_MARGIN_PX = 256
NOISE_STRIP_PX = 36
SHADOW_BLUR_PX = 15
PIECES = 12


class Camera:
    """Render images of one phantom.

    Args:
        eye: The eye.
        settings: Lens, sensor, light.
        needle: The instrument.
        appearance: Style of the phantom.
        seed: Seed of texture and noise.
        distractors: Other objects and effects in the image.
    """

    def __init__(
        self,
        eye: Eye,
        settings: CameraSettings,
        needle: NeedleShape,
        appearance: Appearance,
        seed: int,
        distractors: Distractors | None = None,
    ) -> None:
        self.settings = settings
        size_px = settings.width_px, settings.height_px
        tilt = slant_of(settings)
        self._is_tilted = settings.tilt_deg != (0.0, 0.0)
        self._image_from_frontal = tilt.image_from_frontal.matrix
        self.geometry = image_geometry(settings)
        self.frontal = replace(self.geometry, frontal_from_image=None)
        """Geometry of the frontal image, before the camera's tilt."""
        self._seed = seed
        rim = rim_geometry(self.frontal, tilt.foot_px, eye.shape.rim_mm / settings.distance_mm)
        painted = paint_phantom(eye, self.frontal, rim, size_px, appearance, seed)
        self.light = settings.exposure * vignette(size_px, settings.vignetting)
        """Light that reaches each pixel, (h, w)."""
        self._background = blurred(painted, settings.blur_px) * self.light[..., None]
        self._radius_px = eye.radius_mm * settings.px_per_mm
        distance = distance_map(*size_px, settings.center_px)
        self._in_bowl = np.clip(self._radius_px - distance, 0, 1)
        self.in_view = self._needle_in_view(eye, rim)
        """Where instruments are visible, 0 to 1, (h, w)."""
        self._shaded_by = shading_positions(distance, self._radius_px, settings.shadow_shift)
        self._tone, self._cover = needle_texture(needle, settings.px_per_mm, settings.blur_px, seed)
        self._distractors = distractors or Distractors()
        self._bubbles = self._paint_distractors(eye)
        self._static = np.asarray(cv2.convertScaleAbs(self._background), np.uint8)
        rng = np.random.default_rng((seed, 3))
        tile = settings.height_px + NOISE_MARGIN_PX, settings.width_px + NOISE_MARGIN_PX
        self._noise = rng.standard_normal(tile, np.float32)
        grey = np.arange(256, dtype=np.float32)
        self._sd_of = np.sqrt(settings.read_noise_grey**2 + settings.shot_noise_grey**2 * grey / 255)
        self._sd = self._noise_sd(self._static)

    def render(
        self,
        tip_mm: Vec,
        direction: Vec,
        number: int,
        overlay: Callable[[Image], None] | None = None,
        warp: Callable[[FloatImage, ImageGeometry], tuple[Box, FloatImage] | None] | None = None,
    ) -> Image:
        """Take one image.

        Args:
            tip_mm: The needle's tip, eye frame.
            direction: From the shaft to the tip, length 1, eye frame.
            number: Number of the image; chooses the noise.
            overlay: Draws other moving objects into the frontal image, in front of the needle.
            warp: Returns the part of the static background that has changed, behind the needle.

        Returns:
            (height, width, 3) BGR.
        """
        warped = warp and warp(self._background, self.frontal)
        if not warped:
            return self._render(tip_mm, direction, number, overlay)
        box, scene = warped
        layers: tuple[NDArray[Any], ...] = (self._background, self._static, self._sd)
        saved = [layer[box].copy() for layer in layers]
        self._background[box] = scene
        self._static[box] = cv2.convertScaleAbs(scene)
        self._sd[box] = self._noise_sd(self._static[box])
        try:
            return self._render(tip_mm, direction, number, overlay)
        finally:
            for layer, part in zip(layers, saved, strict=True):
                layer[box] = part

    def _render(
        self, tip_mm: Vec, direction: Vec, number: int, overlay: Callable[[Image], None] | None
    ) -> Image:
        tip, along = self._in_frontal(tip_mm, direction)
        box = self._needle_box(tip, along)
        image = self._static.copy()
        if box is not None:
            image[box] = cv2.convertScaleAbs(self._draw(tip, along, box))
        if overlay is not None:
            overlay(image)
        if overlay or self._distractors.bubbles or self._distractors.flicker or self._is_tilted:
            image = self._with_tilt(self._with_disturbances(image, number))
            return self._with_noise(image, self._noise_sd(image), number)
        if box is None:
            return self._with_noise(image, self._sd, number)
        unchanged = self._sd[box].copy()
        self._sd[box] = self._noise_sd(image[box])
        image = self._with_noise(image, self._sd, number)
        self._sd[box] = unchanged
        return image

    def expect(self, tip_mm: Vec, direction: Vec) -> tuple[FloatImage, FloatImage]:
        """Return the mean and standard deviation of an image's grey, without bubbles, flicker and tilt.

        Not rounded, so that it can be differentiated; positions are exact to 1/32 px (OpenCV's warp).

        Args:
            tip_mm: The needle's tip, eye frame.
            direction: From the shaft to the tip, length 1, eye frame.

        Returns:
            Grey, 0 to 255, and the standard deviation of the sensor noise in grey levels, which is the same
            in all three colours; (height, width) each.
        """
        tip, along = self._in_frontal(tip_mm, direction)
        box = self._needle_box(tip, along)
        scene = self._background.copy()
        if box is not None:
            scene[box] = self._draw(tip, along, box)
        grey = np.asarray(cv2.cvtColor(np.clip(scene, 0, 255), cv2.COLOR_BGR2GRAY), np.float32)
        read, shot = self.settings.read_noise_grey, self.settings.shot_noise_grey
        return grey, np.sqrt(read**2 + shot**2 * grey / 255)

    def _paint_distractors(self, eye: Eye) -> Bubbles:
        """Paint the static distractors into the background; return the moving ones."""
        distractors, settings = self._distractors, self.settings
        if distractors.light_pipe_mm:
            self._background = paint_light_pipe(
                self._background,
                distractors,
                eye,
                self.frontal,
                self.in_view,
                light=self.light,
                blur_px=settings.blur_px,
                seed=self._seed,
            )
        if distractors.specular_highlights:
            self._background = paint_specular_highlights(
                self._background, distractors.specular_highlights, self.frontal, eye.radius_mm, self._seed
            )
        largest_px = distractors.bubble_mm * settings.px_per_mm
        return Bubbles(distractors.bubbles, largest_px, self.frontal, eye.radius_mm, self._seed)

    def _with_disturbances(self, image: Image, number: int) -> Image:
        """Add bubbles and flicker to an image."""
        self._bubbles.draw(image, number)
        gain = flicker_gain(self._distractors.flicker, self._seed, number)
        return np.asarray(cv2.convertScaleAbs(image, alpha=gain), np.uint8)

    def _with_tilt(self, image: Image) -> Image:
        """Return the image that the tilted camera takes, given the frontal one."""
        if not self._is_tilted:
            return image
        size, border = (self.settings.width_px, self.settings.height_px), cv2.BORDER_REPLICATE
        tilted = cv2.warpPerspective(image, self._image_from_frontal, size, borderMode=border)
        return np.asarray(tilted, np.uint8)

    def _in_frontal(self, tip_mm: Vec, direction: Vec) -> tuple[Vec, Vec]:
        """Return tip [px] and direction (length 1) in the frontal image."""
        tip = self.frontal.to_px(tip_mm)
        ahead = subtract(self.frontal.to_px((tip_mm[0] + direction[0], tip_mm[1] + direction[1])), tip)
        return tip, (ahead[0] / norm(ahead), ahead[1] / norm(ahead))

    def _draw(self, tip: Vec, along: Vec, box: Box) -> FloatImage:
        """Return a part of the scene with needle and shadow."""
        scene = self._background[box].copy()
        pieces = [(piece, relative_box(piece, box)) for piece in self._pieces(tip, along)]
        cover = np.zeros(scene.shape[:2], np.float32)
        for piece, part in pieces:
            cover[part] = warp_texture(self._cover, tip, along, piece)
        if self.settings.shadow:
            self._cast_shadow(scene, cover, box)
        cover *= self.in_view[box]
        for piece, part in pieces:
            color = cv2.merge([warp_texture(self._tone, tip, along, piece) * self.light[piece]] * 3)
            over = cover[part].copy()
            scene[part] = cv2.blendLinear(color, scene[part], over, 1 - over)
            cover[part] = 0  # pieces overlap
        return scene

    def _cast_shadow(self, scene: FloatImage, cover: FloatImage, box: Box) -> None:
        """Darken the bowl, within a box, where the needle blocks the light."""
        (cx, cy), radius = self.settings.center_px, self._radius_px
        rows, columns = box
        bowl = clipped_box(
            max(cx - radius, columns.start),
            max(cy - radius, rows.start),
            min(cx + radius, columns.stop - 1),
            min(cy + radius, rows.stop - 1),
            self._sd.shape,
        )
        if bowl is None:
            return
        shift_x, shift_y = (positions[bowl] for positions in self._shaded_by)
        shade = cv2.remap(cover, shift_x - columns.start, shift_y - rows.start, cv2.INTER_LINEAR)
        light = 1 - self.settings.shadow * cv2.blur(shade, (SHADOW_BLUR_PX,) * 2) * self._in_bowl[bowl]
        part = relative_box(bowl, box)
        scene[part] = cv2.multiply(scene[part], cv2.merge([light] * 3))

    def _noise_sd(self, image: Image) -> FloatImage:
        """Return the standard deviation of the sensor noise for an image, (h, w) grey levels."""
        return np.asarray(cv2.LUT(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), self._sd_of), np.float32)

    def _with_noise(self, image: Image, sd_grey: FloatImage, number: int) -> Image:
        """Add sensor noise in place, the same in all three colours (JPEG preserves little more)."""
        rng = np.random.default_rng((self._seed, 4, number))
        top, left = rng.integers(0, NOISE_MARGIN_PX, 2)
        noise = self._noise[top : top + image.shape[0], left : left + image.shape[1]]
        # Strips fit in the processor's cache. Adding and subtracting separately, each saturating in 8 bits,
        # is four times as fast as one pass in float.
        for start in range(0, image.shape[0], NOISE_STRIP_PX):
            strip = slice(start, start + NOISE_STRIP_PX)
            for change, scale in ((cv2.add, 1), (cv2.subtract, -1)):
                grey = cv2.multiply(sd_grey[strip], noise[strip], scale=scale, dtype=cv2.CV_8U)
                change(image[strip], cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), dst=image[strip])
        return image

    def _pieces(self, tip: Vec, along: Vec) -> list[Box]:
        """Return boxes that cover the needle tightly; one box around a long shaft is mostly background."""
        half = self._cover.shape[0] / 2 + 2
        step = self._cover.shape[1] / PIECES
        boxes = []
        for number in range(PIECES):
            ends = [
                (tip[0] - s * along[0], tip[1] - s * along[1]) for s in (number * step, (number + 1) * step)
            ]
            (left, right), (top, bottom) = (sorted(values) for values in zip(*ends, strict=True))
            boxes.append(clipped_box(left - half, top - half, right + half, bottom + half, self._sd.shape))
        return [box for box in boxes if box is not None]

    def _needle_box(self, tip: Vec, along: Vec) -> Box | None:
        """Return the part of the image that needle and shadow can cover; None if they are out of view."""
        pieces = self._pieces(tip, along)
        if not pieces:
            return None
        right, down = (
            shift * self._radius_px if self.settings.shadow else 0 for shift in self.settings.shadow_shift
        )
        return clipped_box(
            min(columns.start for _, columns in pieces) + min(right, 0),
            min(rows.start for rows, _ in pieces) + min(down, 0),
            max(columns.stop for _, columns in pieces) + max(right, 0),
            max(rows.stop for rows, _ in pieces) + max(down, 0),
            self._sd.shape,
        )

    def _needle_in_view(self, eye: Eye, rim: ImageGeometry) -> FloatImage:
        """Return where a needle is visible, 0 to 1, (h, w): everywhere but inside the wall."""
        settings = self.settings
        distance = distance_map(settings.width_px, settings.height_px, rim.center_px)
        inner = eye.radius_mm / rim.mm_per_px
        outer = inner + eye.shape.wall_mm / rim.mm_per_px
        visible = np.maximum(np.clip(inner - distance + 0.5, 0, 1), np.clip(distance - outer + 0.5, 0, 1))
        return blurred(visible, settings.blur_px)
