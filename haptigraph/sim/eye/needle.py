"""A straight instrument as a texture along x, and its warp into an image at any pose."""

import math
from collections.abc import Sequence
from typing import Annotated, TypeAlias

import cv2
import numpy as np
from msgspec import Meta, Struct

from haptigraph.geometry import Vec
from haptigraph.imaging import FloatImage

__all__ = [
    "Box",
    "NeedleShape",
    "blurred",
    "clipped_box",
    "joined_box",
    "needle_texture",
    "relative_box",
    "warp_texture",
]

SUPERSAMPLING = 4
PADDING_PX = 3

Box: TypeAlias = tuple[slice, slice]
"""Rows and columns of an image."""


class NeedleShape(Struct, frozen=True, forbid_unknown_fields=True):
    """The [needle] table of a scenario."""

    diameter_mm: float = 0.8
    tip_diameter_mm: float = 0.12
    taper_mm: float = 9.0
    """Length of the cone behind the tip."""
    length_mm: float = 60.0
    brightness: float = 0.44
    """Brightness of the metal, in [0, 1]."""
    highlight: float = 0.05
    """Added brightness of the specular highlight along the middle."""
    tilt_deg: Annotated[float, Meta(gt=-80, lt=80)] = 0.0
    """Angle out of the plane of the section, which foreshortens the shaft by its cosine. Depth and tip are
    still measured in the plane."""


def needle_texture(
    needle: NeedleShape, px_per_mm: float, blur_px: float, seed: int
) -> tuple[FloatImage, FloatImage]:
    """Draw an instrument along x with its tip at the left.

    Args:
        needle: Its shape and brightness.
        px_per_mm: Scale of the image.
        blur_px: Standard deviation of the lens blur.
        seed: Seed of the metal's grain.

    Returns:
        Brightness, 0 to 255, and coverage, 0 to 1; (h, w) each.
    """
    scale, foreshortening = px_per_mm, math.cos(math.radians(needle.tilt_deg))
    length = math.ceil(needle.length_mm * foreshortening * scale) + PADDING_PX
    half = math.ceil(needle.diameter_mm * scale / 2) + PADDING_PX
    rows, columns = (2 * half + 1) * SUPERSAMPLING, length * SUPERSAMPLING
    along_px = (np.arange(columns) + 0.5) / SUPERSAMPLING - 0.5 - PADDING_PX
    across_px = (np.arange(rows) + 0.5) / SUPERSAMPLING - 0.5 - half
    share = np.clip(along_px / (needle.taper_mm * foreshortening * scale), 0, 1)
    tip, shaft = needle.tip_diameter_mm / 2, needle.diameter_mm / 2
    radius_px = scale * (tip + (shaft - tip) * share)
    covered = (np.abs(across_px)[:, None] <= radius_px) & (along_px >= 0)
    height = np.clip(across_px[:, None] / radius_px, -1, 1)
    lit = 0.72 + 0.28 * np.sqrt(1 - height**2) - 0.07 * height
    highlight = np.exp(-(((height + 0.15) / 0.3) ** 2))
    rng = np.random.default_rng((seed, 5))
    grain = cv2.resize(rng.standard_normal((rows // 3, columns // 8)).astype(np.float32), (columns, rows))
    tone = needle.brightness * lit * (1 + 0.06 * grain) + needle.highlight * highlight
    size = (length, 2 * half + 1)
    color = cv2.resize((255 * np.clip(tone, 0, 1)).astype(np.float32), size, interpolation=cv2.INTER_AREA)
    cover = cv2.resize(covered.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    cover = blurred(np.asarray(cover, np.float32), blur_px)
    return np.asarray(color, np.float32), cover


def warp_texture(texture: FloatImage, tip_px: Vec, along: Vec, box: Box) -> FloatImage:
    """Warp a texture, whose tip is at the middle of its left edge, into a box of the image.

    Args:
        texture: One of those that `needle_texture` returns.
        tip_px: Position of the tip in the image.
        along: Direction from the shaft to the tip in the image, length 1.
        box: The part of the image to draw.

    Returns:
        The box's pixels, 0 outside the texture.
    """
    rows, columns = box
    middle = (texture.shape[0] - 1) / 2
    x, y = tip_px[0] - columns.start, tip_px[1] - rows.start
    # The texture's columns run from the tip back along the shaft, its rows across it.
    box_from_texture = np.array(
        [
            [-along[0], -along[1], x + PADDING_PX * along[0] + middle * along[1]],
            [-along[1], along[0], y + PADDING_PX * along[1] - middle * along[0]],
        ]
    )
    size = columns.stop - columns.start, rows.stop - rows.start
    warped = cv2.warpAffine(texture, box_from_texture, size, flags=cv2.INTER_LINEAR)
    return np.asarray(warped, np.float32)


def blurred(image: FloatImage, sd_px: float) -> FloatImage:
    """Blur an image with a Gaussian; 0 leaves it unchanged."""
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sd_px), np.float32) if sd_px else image


def clipped_box(left: float, top: float, right: float, bottom: float, size: tuple[int, ...]) -> Box | None:
    """Return the box around a rectangle within an image of (height, width); None if it is outside."""
    rows = slice(max(math.floor(top), 0), min(math.ceil(bottom) + 1, size[0]))
    columns = slice(max(math.floor(left), 0), min(math.ceil(right) + 1, size[1]))
    return (rows, columns) if rows.start < rows.stop and columns.start < columns.stop else None


def relative_box(inner: Box, outer: Box) -> Box:
    """Return a box relative to the top-left corner of another one that contains it."""
    rows, columns = (
        slice(part.start - whole.start, part.stop - whole.start)
        for part, whole in zip(inner, outer, strict=True)
    )
    return rows, columns


def joined_box(boxes: Sequence[Box]) -> Box | None:
    """Return the smallest box around some boxes; None without any."""
    if not boxes:
        return None
    rows, columns = (
        slice(min(part.start for part in parts), max(part.stop for part in parts))
        for parts in zip(*boxes, strict=True)
    )
    return rows, columns
