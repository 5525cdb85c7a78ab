"""Distractors beside eye and needle: second instrument, specular highlights, bubbles, clutter, flicker.

Static distractors are painted into the background once; bubbles and flicker depend on the image's number and
the seed.
"""

import math
from typing import Annotated, ClassVar

import cv2
import numpy as np
from msgspec import Meta, Struct

from haptigraph.geometry import Vec
from haptigraph.imaging import FloatImage
from haptigraph.messages import Image
from haptigraph.projection import ImageGeometry
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.needle import NeedleShape, clipped_box, needle_texture, warp_texture

__all__ = ["Bubbles", "Distractors", "flicker_gain", "paint_light_pipe", "paint_specular_highlights"]

Count = Annotated[int, Meta(ge=0, le=100)]
Share = Annotated[float, Meta(ge=0, le=1)]
HIGHLIGHT_MM = (0.15, 0.7)
DRIFT_PX = 1.2  # of a bubble, from image to image
RING_PX = 1.3


class Distractors(Struct, frozen=True, forbid_unknown_fields=True):
    """The [distractors] table of a scenario; all are off by default."""

    OLD_KEYS: ClassVar[dict[str, str]] = {"glints": "specular_highlights"}

    specular_highlights: Count = 0
    """Number of saturated reflections on bowl and wall."""
    vessels: Count = 0
    """Number of winding vessels on the bowl."""
    lines: Count = 0
    """Number of straight lines on the bowl, dark or bright, such as print lines and scratches."""
    bubbles: Count = 0
    """Number of drifting bubbles (bright rings) and debris particles (dark blobs), in front of the needle."""
    bubble_mm: Annotated[float, Meta(gt=0, le=5)] = 0.7
    """Diameter of the largest one."""
    flicker: Share = 0.0
    """Relative standard deviation of the light from image to image."""
    light_pipe_mm: Annotated[float, Meta(ge=0, le=24)] = 0.0
    """Depth of a second instrument in the other trocar, behind the needle; 0: none."""
    light_pipe_deg: float = 0.0
    """Its pitch, from the line trocar -> globe centre, counter-clockwise."""
    light_pipe: NeedleShape = NeedleShape(
        diameter_mm=0.6, tip_diameter_mm=0.5, taper_mm=0.5, length_mm=45.0, brightness=0.35, highlight=0.3
    )


def paint_light_pipe(
    background: FloatImage,
    distractors: Distractors,
    eye: Eye,
    geometry: ImageGeometry,
    in_view: FloatImage,
    *,
    light: FloatImage,
    blur_px: float,
    seed: int,
) -> FloatImage:
    """Return a background with the second instrument in front of it.

    Args:
        background: (h, w, 3).
        distractors: Pose and shape of the instrument.
        eye: The eye; the instrument enters through its other trocar.
        geometry: Geometry of the image.
        in_view: Where instruments are visible, 0 to 1, (h, w).
        light: Light that reaches each pixel, (h, w).
        blur_px: Standard deviation of the lens blur.
        seed: Seed of the metal's grain.
    """
    tip_mm, along_mm = eye.second_instrument(distractors.light_pipe_mm, distractors.light_pipe_deg)
    tip_px = geometry.to_px(tip_mm)
    along = -along_mm[0] if geometry.mirrored else along_mm[0], -along_mm[1]
    whole = slice(0, background.shape[0]), slice(0, background.shape[1])
    tone, cover = needle_texture(distractors.light_pipe, 1 / geometry.mm_per_px, blur_px, seed + 1)
    over = warp_texture(cover, tip_px, along, whole) * in_view
    color = cv2.merge([warp_texture(tone, tip_px, along, whole) * light] * 3)
    return np.asarray(cv2.blendLinear(color, background, over, 1 - over), np.float32)


def paint_specular_highlights(
    background: FloatImage, count: int, geometry: ImageGeometry, radius_mm: float, seed: int
) -> FloatImage:
    """Return a background with randomly elongated specular highlights on the globe and its wall."""
    rng = np.random.default_rng((seed, 7))
    highlight = np.zeros(background.shape[:2], np.float32)
    for _ in range(count):
        turn, reach_mm = rng.uniform(0, 2 * math.pi), radius_mm * math.sqrt(rng.uniform(0, 1.2))
        at_px = geometry.to_px((reach_mm * math.cos(turn), reach_mm * math.sin(turn)))
        axes_px = rng.uniform(*HIGHLIGHT_MM, 2) / geometry.mm_per_px / 2
        angle_deg = rng.uniform(0, 180)
        _ellipse(highlight, at_px, (float(axes_px[0]), float(axes_px[1])), angle_deg, 1.0)
    core = cv2.GaussianBlur(highlight, (0, 0), 1.0)
    halo = cv2.GaussianBlur(highlight, (0, 0), 0.25 / geometry.mm_per_px)
    return np.asarray(background + (300 * core + 60 * halo)[..., None], np.float32)


class Bubbles:
    """Drifting bubbles and debris.

    Args:
        count: How many.
        largest_px: Diameter of the largest one.
        geometry: Geometry of the image.
        radius_mm: They stay within this distance of the globe's centre.
        seed: Seed of their positions and drift.
    """

    def __init__(
        self, count: int, largest_px: float, geometry: ImageGeometry, radius_mm: float, seed: int
    ) -> None:
        rng = np.random.default_rng((seed, 8))
        self._center_px = geometry.center_px
        self._limit_px = 0.92 * radius_mm / geometry.mm_per_px
        self._radii_px = rng.uniform(0.3, 1.0, count) * largest_px / 2
        turn, reach = rng.uniform(0, 2 * math.pi, count), self._limit_px * np.sqrt(rng.uniform(0, 1, count))
        self._start_px = np.stack([reach * np.cos(turn), reach * np.sin(turn)], axis=1)
        self._drift_px = rng.uniform(-DRIFT_PX, DRIFT_PX, (count, 2))

    def draw(self, image: Image, number: int) -> None:
        """Draw them into an image, in place.

        Args:
            image: (h, w, 3).
            number: Number of the image, which determines the drift.
        """
        for which, radius_px in enumerate(self._radii_px):
            x, y = self._start_px[which] + number * self._drift_px[which]
            # A bubble that reaches the limit re-enters on the opposite side.
            if math.hypot(x, y) > self._limit_px:
                turns = 2 * self._limit_px
                x, y = ((v + self._limit_px) % turns - self._limit_px for v in (x, y))
                if math.hypot(x, y) > self._limit_px:
                    continue
            at_px = self._center_px[0] + float(x), self._center_px[1] + float(y)
            _blend_blob(image, at_px, float(radius_px), is_bubble=which % 2 == 0)


def flicker_gain(flicker: float, seed: int, number: int) -> float:
    """Return the light of one image relative to the mean, at least 0.2."""
    rng = np.random.default_rng((seed, 9, number))
    return max(1 + flicker * float(rng.standard_normal()), 0.2)


def _blend_blob(image: Image, at_px: Vec, radius_px: float, *, is_bubble: bool) -> None:
    (center_x, center_y), reach_px = at_px, radius_px + 6
    box = clipped_box(
        center_x - reach_px, center_y - reach_px, center_x + reach_px, center_y + reach_px, image.shape
    )
    if box is None:
        return
    rows, columns = box
    y, x = np.mgrid[rows, columns]
    distance = np.hypot(x - at_px[0], y - at_px[1])
    part = image[box].astype(np.float32)
    if is_bubble:
        ring = np.exp(-(((distance - radius_px) / RING_PX) ** 2))
        highlight = np.exp(-(((x - at_px[0] + radius_px / 3) ** 2 + (y - at_px[1] + radius_px / 3) ** 2) / 4))
        part = part * (1 - 0.5 * ring[..., None]) + (150 * ring + 120 * highlight)[..., None]
    else:
        cover = np.clip(radius_px - distance + 0.5, 0, 1) * 0.6
        part = part * (1 - cover[..., None])
    image[box] = np.clip(np.rint(part), 0, 255).astype(np.uint8)


def _ellipse(mask: FloatImage, at_px: Vec, axes_px: Vec, angle_deg: float, value: float) -> None:
    shift = 4  # bits of sub-pixel
    center = round(at_px[0] * 2**shift), round(at_px[1] * 2**shift)
    axes = max(round(axes_px[0] * 2**shift), 1), max(round(axes_px[1] * 2**shift), 1)
    cv2.ellipse(mask, center, axes, angle_deg, 0, 360, value, cv2.FILLED, cv2.LINE_8, shift)
