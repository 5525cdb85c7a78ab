"""The simulated camera: puts the needle and its shadow into the painted phantom, then lens and sensor.

Seen through a mirror like the real one. The same pose and image number always give the same pixels.
Knows nothing of retina, states or touch.
"""

import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from haptigraph.geometry import ImageGeometry, Vec, norm, subtract
from haptigraph.messages import Image
from haptigraph.sim.eye.distractors import Bubbles, Distractors, flicker_gain, paint_glints, paint_light_pipe
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.needle import Box, NeedleShape, blurred, lay, needle_texture, within
from haptigraph.sim.eye.optics import CameraSettings, image_geometry, slant_of
from haptigraph.sim.eye.painter import (
    FloatImage,
    distance_map,
    paint_phantom,
    rim_geometry,
    shading_places,
    vignette,
)
from haptigraph.sim.eye.palette import Look

__all__ = ["Camera", "NeedleShape"]

NOISE_MARGIN_PX = 256
NOISE_STRIP_PX = 36
SHADOW_BLUR_PX = 15
PIECES = 12


class Camera:
    """Render one phantom.

    Args:
        eye: The eye.
        settings: Lens, sensor, light.
        needle: The instrument.
        look: Style of the phantom.
        seed: Of texture and noise.
        distractors: What else is in the picture.
    """

    def __init__(
        self,
        eye: Eye,
        settings: CameraSettings,
        needle: NeedleShape,
        look: Look,
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
        """Of the picture before it is seen at a slant."""
        self._seed = seed
        rim = rim_geometry(self.frontal, tilt.foot_px, eye.shape.rim_mm / settings.distance_mm)
        painted = paint_phantom(eye, self.frontal, rim, size_px, look, seed)
        self.light = settings.exposure * vignette(size_px, settings.vignetting)
        """That reaches each pixel, (h, w)."""
        self._background = blurred(painted, settings.blur_px) * self.light[..., None]
        self._radius_px = eye.radius_mm * settings.px_per_mm
        distance = distance_map(*size_px, settings.center_px)
        self._in_bowl = np.clip(self._radius_px - distance, 0, 1)
        self.in_view = self._needle_in_view(eye, rim)
        """Where instruments are seen, 0 to 1, (h, w)."""
        self._shaded_by = shading_places(distance, self._radius_px, settings.shadow_shift)
        self._tone, self._cover = needle_texture(needle, settings.px_per_mm, settings.blur_px, seed)
        self._distractors = distractors or Distractors()
        self._bubbles = self._paint_distractors(eye)
        self._still = np.asarray(cv2.convertScaleAbs(self._background), np.uint8)
        rng = np.random.default_rng((seed, 3))
        tile = settings.height_px + NOISE_MARGIN_PX, settings.width_px + NOISE_MARGIN_PX
        self._noise = rng.standard_normal(tile, np.float32)
        grey = np.arange(256, dtype=np.float32)
        self._sd_of = np.sqrt(settings.read_noise_grey**2 + settings.shot_noise_grey**2 * grey / 255)
        self._sd = self._noise_sd(self._still)

    def render(
        self,
        tip_mm: Vec,
        direction: Vec,
        number: int,
        overlay: Callable[[Image], None] | None = None,
        bend: Callable[[FloatImage, ImageGeometry], tuple[Box, FloatImage] | None] | None = None,
    ) -> Image:
        """Take one image.

        Args:
            tip_mm: The needle's tip, eye frame.
            direction: From the shaft to the tip, length 1, eye frame.
            number: Of the image; chooses the noise.
            overlay: Draws what else moves into the straight picture, in front of the needle.
            bend: Says which part of what stands still looks otherwise now, and how; behind the needle.

        Returns:
            (height, width, 3) BGR.
        """
        bent = bend and bend(self._background, self.frontal)
        if not bent:
            return self._render(tip_mm, direction, number, overlay)
        box, scene = bent
        stills: tuple[NDArray[Any], ...] = (self._background, self._still, self._sd)
        kept = [still[box].copy() for still in stills]
        self._background[box] = scene
        self._still[box] = cv2.convertScaleAbs(scene)
        self._sd[box] = self._noise_sd(self._still[box])
        try:
            return self._render(tip_mm, direction, number, overlay)
        finally:
            for still, part in zip(stills, kept, strict=True):
                still[box] = part

    def _render(
        self, tip_mm: Vec, direction: Vec, number: int, overlay: Callable[[Image], None] | None
    ) -> Image:
        tip, along = self._in_frontal(tip_mm, direction)
        box = self._needle_box(tip, along)
        image = self._still.copy()
        if box is not None:
            image[box] = cv2.convertScaleAbs(self._draw(tip, along, box))
        if overlay is not None:
            overlay(image)
        if overlay or self._distractors.bubbles or self._distractors.flicker or self._is_tilted:
            image = self._tilted(self._disturbed(image, number))
            return self._with_noise(image, self._noise_sd(image), number)
        if box is None:
            return self._with_noise(image, self._sd, number)
        bare = self._sd[box].copy()
        self._sd[box] = self._noise_sd(image[box])
        image = self._with_noise(image, self._sd, number)
        self._sd[box] = bare
        return image

    def expect(self, tip_mm: Vec, direction: Vec) -> tuple[FloatImage, FloatImage]:
        """Return the mean and the deviation of an image's grey, without bubbles, flicker and tilt.

        Not rounded, so that it can be differentiated; places are exact to 1/32 px (OpenCV's warp).

        Args:
            tip_mm: The needle's tip, eye frame.
            direction: From the shaft to the tip, length 1, eye frame.

        Returns:
            Grey, 0 to 255, and the deviation of the sensor's noise in grey levels, which is the same in all
            three colours; (height, width) each.
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
        """Paint what stands still into the background, and return what moves."""
        given, settings = self._distractors, self.settings
        if given.light_pipe_mm:
            self._background = paint_light_pipe(
                self._background,
                given,
                eye,
                self.frontal,
                self.in_view,
                light=self.light,
                blur_px=settings.blur_px,
                seed=self._seed,
            )
        if given.glints:
            self._background = paint_glints(
                self._background, given.glints, self.frontal, eye.radius_mm, self._seed
            )
        largest_px = given.bubble_mm * settings.px_per_mm
        return Bubbles(given.bubbles, largest_px, self.frontal, eye.radius_mm, self._seed)

    def _disturbed(self, image: Image, number: int) -> Image:
        """Put bubbles into an image and change its light."""
        self._bubbles.draw(image, number)
        gain = flicker_gain(self._distractors.flicker, self._seed, number)
        return np.asarray(cv2.convertScaleAbs(image, alpha=gain), np.uint8)

    def _tilted(self, image: Image) -> Image:
        """Return what the camera sees of the straight picture."""
        if not self._is_tilted:
            return image
        size, border = (self.settings.width_px, self.settings.height_px), cv2.BORDER_REPLICATE
        seen = cv2.warpPerspective(image, self._image_from_frontal, size, borderMode=border)
        return np.asarray(seen, np.uint8)

    def _in_frontal(self, tip_mm: Vec, direction: Vec) -> tuple[Vec, Vec]:
        """Return tip [px] and direction (length 1) in the straight picture."""
        tip = self.frontal.to_px(tip_mm)
        ahead = subtract(self.frontal.to_px((tip_mm[0] + direction[0], tip_mm[1] + direction[1])), tip)
        return tip, (ahead[0] / norm(ahead), ahead[1] / norm(ahead))

    def _draw(self, tip: Vec, along: Vec, box: Box) -> FloatImage:
        """Return a part of the scene with needle and shadow."""
        scene = self._background[box].copy()
        pieces = [(piece, within(piece, box)) for piece in self._pieces(tip, along)]
        cover = np.zeros(scene.shape[:2], np.float32)
        for piece, part in pieces:
            cover[part] = lay(self._cover, tip, along, piece)
        if self.settings.shadow:
            self._cast_shadow(scene, cover, box)
        cover *= self.in_view[box]
        for piece, part in pieces:
            color = cv2.merge([lay(self._tone, tip, along, piece) * self.light[piece]] * 3)
            over = cover[part].copy()
            scene[part] = cv2.blendLinear(color, scene[part], over, 1 - over)
            cover[part] = 0  # pieces overlap
        return scene

    def _cast_shadow(self, scene: FloatImage, cover: FloatImage, box: Box) -> None:
        """Darken the bowl, as far as it lies in a box, where the needle stands between it and the light."""
        (cx, cy), radius = self.settings.center_px, self._radius_px
        rows, columns = box
        bowl = self._clipped(
            max(cx - radius, columns.start),
            max(cy - radius, rows.start),
            min(cx + radius, columns.stop - 1),
            min(cy + radius, rows.stop - 1),
        )
        if bowl is None:
            return
        shift_x, shift_y = (places[bowl] for places in self._shaded_by)
        shade = cv2.remap(cover, shift_x - columns.start, shift_y - rows.start, cv2.INTER_LINEAR)
        light = 1 - self.settings.shadow * cv2.blur(shade, (SHADOW_BLUR_PX,) * 2) * self._in_bowl[bowl]
        part = within(bowl, box)
        scene[part] = cv2.multiply(scene[part], cv2.merge([light] * 3))

    def _noise_sd(self, image: Image) -> FloatImage:
        """Return the deviation of the sensor's noise for what it sees, (h, w) grey levels."""
        return np.asarray(cv2.LUT(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), self._sd_of), np.float32)

    def _with_noise(self, image: Image, deviation: FloatImage, number: int) -> Image:
        """Add the sensor's noise, in place, the same in all three colours (JPEG keeps hardly more)."""
        rng = np.random.default_rng((self._seed, 4, number))
        top, left = rng.integers(0, NOISE_MARGIN_PX, 2)
        noise = self._noise[top : top + image.shape[0], left : left + image.shape[1]]
        # Strips stay in the processor's cache. Brighter and darker apart, each saturating in 8 bits: four
        # times as fast as one pass in float.
        for start in range(0, image.shape[0], NOISE_STRIP_PX):
            strip = slice(start, start + NOISE_STRIP_PX)
            for change, scale in ((cv2.add, 1), (cv2.subtract, -1)):
                grey = cv2.multiply(deviation[strip], noise[strip], scale=scale, dtype=cv2.CV_8U)
                change(image[strip], cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), dst=image[strip])
        return image

    def _pieces(self, tip: Vec, along: Vec) -> list[Box]:
        """Return boxes that cover the needle closely: a long shaft in one box would be mostly background."""
        half = self._cover.shape[0] / 2 + 2
        step = self._cover.shape[1] / PIECES
        boxes = []
        for number in range(PIECES):
            ends = [
                (tip[0] - s * along[0], tip[1] - s * along[1]) for s in (number * step, (number + 1) * step)
            ]
            (left, right), (top, bottom) = (sorted(values) for values in zip(*ends, strict=True))
            boxes.append(self._clipped(left - half, top - half, right + half, bottom + half))
        return [box for box in boxes if box is not None]

    def _needle_box(self, tip: Vec, along: Vec) -> Box | None:
        """Return the part of the image that needle and shadow can touch; None if they are out of view."""
        pieces = self._pieces(tip, along)
        if not pieces:
            return None
        right, down = (
            shift * self._radius_px if self.settings.shadow else 0 for shift in self.settings.shadow_shift
        )
        return self._clipped(
            min(columns.start for _, columns in pieces) + min(right, 0),
            min(rows.start for rows, _ in pieces) + min(down, 0),
            max(columns.stop for _, columns in pieces) + max(right, 0),
            max(rows.stop for rows, _ in pieces) + max(down, 0),
        )

    def _clipped(self, left: float, top: float, right: float, bottom: float) -> Box | None:
        columns = slice(max(math.floor(left), 0), min(math.ceil(right) + 1, self.settings.width_px))
        rows = slice(max(math.floor(top), 0), min(math.ceil(bottom) + 1, self.settings.height_px))
        return (rows, columns) if columns.start < columns.stop and rows.start < rows.stop else None

    def _needle_in_view(self, eye: Eye, rim: ImageGeometry) -> FloatImage:
        """Return where a needle can be seen: not within the wall, which hides it."""
        settings = self.settings
        distance = distance_map(settings.width_px, settings.height_px, rim.center_px)
        inner = eye.radius_mm / rim.mm_per_px
        outer = inner + eye.shape.wall_mm / rim.mm_per_px
        seen = np.maximum(np.clip(inner - distance + 0.5, 0, 1), np.clip(distance - outer + 0.5, 0, 1))
        return blurred(seen, settings.blur_px)
