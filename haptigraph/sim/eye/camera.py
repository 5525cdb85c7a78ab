"""The simulated camera: render needle and shadow into the painted phantom, then model lens and sensor.

The view is mirrored like the real one. The same pose and image number always give the same pixels.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import cv2
import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from haptigraph.geometry import Vec, norm, subtract
from haptigraph.imaging import FloatImage
from haptigraph.messages import Image
from haptigraph.projection import ImageGeometry
from haptigraph.sim.eye.cannula import Cannula, CannulaShape
from haptigraph.sim.eye.clutter import paint_lines, paint_vessels
from haptigraph.sim.eye.distractors import (
    Bubbles,
    Distractors,
    flicker_gain,
    paint_light_pipe,
    paint_specular_highlights,
)
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.motion_blur import line_kernel
from haptigraph.sim.eye.needle import (
    Box,
    NeedleShape,
    blurred,
    clipped_box,
    joined_box,
    needle_texture,
    relative_box,
    warp_texture,
)
from haptigraph.sim.eye.optics import CameraSettings, image_geometry, slant_of
from haptigraph.sim.eye.painter import distance_map, paint_phantom, rim_geometry, shading_positions, vignette
from haptigraph.sim.eye.palette import Appearance
from haptigraph.sim.eye.sensor import Sensor

__all__ = ["Camera", "NeedleShape"]

Needle: TypeAlias = tuple[Vec, Vec]
"""Tip [mm] and direction (length 1), eye frame."""

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
        cannula: The tube in the trocar in use; None: there is none.
    """

    def __init__(
        self,
        eye: Eye,
        settings: CameraSettings,
        needle: NeedleShape,
        appearance: Appearance,
        seed: int,
        distractors: Distractors | None = None,
        cannula: CannulaShape | None = None,
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
        self._cannula = cannula and Cannula(cannula, eye, self.frontal, settings.blur_px, seed)
        self._shake = line_kernel(settings.shake_px, settings.shake_deg) if settings.shake_px else None
        self._distractors = distractors or Distractors()
        self._bubbles = self._paint_distractors(eye)
        others = self._distractors
        self._is_disturbed = bool(
            others.bubbles or others.flicker or self._is_tilted or self._shake is not None
        )
        self._static = np.asarray(cv2.convertScaleAbs(self._background), np.uint8)
        self._sensor = Sensor(settings, seed)
        self._sd = self._sensor.noise_sd(self._static)

    def render(
        self,
        tip_mm: Vec,
        direction: Vec,
        number: int,
        overlay: Callable[[Image], None] | None = None,
        warp: Callable[[FloatImage, ImageGeometry], tuple[Box, FloatImage] | None] | None = None,
        exposure: Sequence[Needle] = (),
    ) -> Image:
        """Take one image.

        Args:
            tip_mm: The needle's tip, eye frame.
            direction: From the shaft to the tip, length 1, eye frame.
            number: Number of the image; chooses the noise.
            overlay: Draws other moving objects into the frontal image, in front of the needle.
            warp: Returns the part of the static background that has changed, behind the needle.
            exposure: The needle at equal steps of the exposure, like `tip_mm` and `direction`, which are
                those of its middle; empty: it does not move.

        Returns:
            (height, width, 3) BGR.
        """
        poses = exposure or ((tip_mm, direction),)
        warped = warp and warp(self._background, self.frontal)
        if not warped:
            return self._render(poses, number, overlay)
        box, scene = warped
        layers: tuple[NDArray[Any], ...] = (self._background, self._static, self._sd)
        saved = [layer[box].copy() for layer in layers]
        self._background[box] = scene
        self._static[box] = cv2.convertScaleAbs(scene)
        self._sd[box] = self._sensor.noise_sd(self._static[box])
        try:
            return self._render(poses, number, overlay)
        finally:
            for layer, part in zip(layers, saved, strict=True):
                layer[box] = part

    def _render(self, poses: Sequence[Needle], number: int, overlay: Callable[[Image], None] | None) -> Image:
        box = self._changed_box(poses)
        image = self._static.copy()
        if box is not None:
            image[box] = cv2.convertScaleAbs(self._exposed(poses, box))
        if overlay is not None:
            overlay(image)
        if overlay or self._is_disturbed:
            image = self._with_shake(self._with_tilt(self._with_disturbances(image, number)))
            return self._sensor.with_noise(image, self._sensor.noise_sd(image), number)
        if box is None:
            return self._sensor.with_noise(image, self._sd, number)
        unchanged = self._sd[box].copy()
        self._sd[box] = self._sensor.noise_sd(image[box])
        image = self._sensor.with_noise(image, self._sd, number)
        self._sd[box] = unchanged
        return image

    def expect(self, tip_mm: Vec, direction: Vec) -> tuple[FloatImage, FloatImage]:
        """Return the mean and standard deviation of an image's grey: no bubbles, flicker, tilt and shake.

        Not rounded, so that it can be differentiated; positions are exact to 1/32 px (OpenCV's warp).

        Args:
            tip_mm: The needle's tip, eye frame.
            direction: From the shaft to the tip, length 1, eye frame.

        Returns:
            Grey, 0 to 255, and the standard deviation of the sensor noise in grey levels, which is the same
            in all three colours; (height, width) each.
        """
        poses = ((tip_mm, direction),)
        box = self._changed_box(poses)
        scene = self._background.copy()
        if box is not None:
            scene[box] = self._exposed(poses, box)
        grey = np.asarray(cv2.cvtColor(np.clip(scene, 0, 255), cv2.COLOR_BGR2GRAY), np.float32)
        read, shot = self.settings.read_noise_grey, self.settings.shot_noise_grey
        return grey, np.sqrt(read**2 + shot**2 * grey / 255)

    def _paint_distractors(self, eye: Eye) -> Bubbles:
        """Paint the static distractors into the background; return the moving ones."""
        distractors, settings = self._distractors, self.settings
        for paint, count in ((paint_vessels, distractors.vessels), (paint_lines, distractors.lines)):
            if count:
                self._background = paint(
                    self._background, count, self.frontal, self._in_bowl, settings.blur_px, self._seed
                )
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

    def _with_shake(self, image: Image) -> Image:
        """Return an image as blurred by the camera's own motion."""
        return image if self._shake is None else np.asarray(cv2.filter2D(image, -1, self._shake), np.uint8)

    def _in_frontal(self, tip_mm: Vec, direction: Vec) -> tuple[Vec, Vec]:
        """Return tip [px] and direction (length 1) in the frontal image."""
        tip = self.frontal.to_px(tip_mm)
        ahead = subtract(self.frontal.to_px((tip_mm[0] + direction[0], tip_mm[1] + direction[1])), tip)
        return tip, (ahead[0] / norm(ahead), ahead[1] / norm(ahead))

    def _changed_box(self, poses: Sequence[Needle]) -> Box | None:
        """Return the part of the image that needle, shadow and cannula can cover; None if out of view."""
        boxes = [self._needle_box(*self._in_frontal(*pose)) for pose in poses]
        if self._cannula:
            boxes.append(self._cannula.box(self._sd.shape))
        return joined_box([box for box in boxes if box is not None])

    def _exposed(self, poses: Sequence[Needle], box: Box) -> FloatImage:
        """Return a part of the scene, averaged over the needle's poses during the exposure."""
        scenes = [self._scene(pose, box) for pose in poses]
        return scenes[0] if len(scenes) == 1 else np.mean(scenes, axis=0, dtype=np.float32)

    def _scene(self, pose: Needle, box: Box) -> FloatImage:
        """Return a part of the scene with needle, shadow and cannula."""
        scene = self._draw(*self._in_frontal(*pose), box)
        if self._cannula:
            self._cannula.draw(scene, box, pose, self.light, self.in_view)
        return scene

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
