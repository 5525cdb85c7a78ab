"""Paint the static background: mask, recess, tube, the cut globe with bowl, retina and trocar holes.

Every region is a signed distance, so that edges are smooth at any scale.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.geometry import Vec, subtract, unit
from haptigraph.imaging import FloatImage
from haptigraph.projection import ImageGeometry
from haptigraph.sim.eye.eye import Eye
from haptigraph.sim.eye.palette import BLOOD, LAYER, Appearance, Color, Palette

__all__ = ["FloatImage", "distance_map", "paint_phantom", "rim_geometry", "shading_positions", "vignette"]

HEMORRHAGE_HEIGHT = 0.5  # as a share of half its width


class _Canvas:
    """An image that is painted region by region."""

    def __init__(self, width_px: int, height_px: int, seed: int) -> None:
        y, x = np.mgrid[:height_px, :width_px]
        self.x, self.y = x.astype(np.float32), y.astype(np.float32)
        self.pixels = np.zeros((height_px, width_px, 3), np.float32)
        self.rng = np.random.default_rng((seed, 2))

    def fill(self, outside_px: FloatImage, color: Color, shade: FloatImage | float = 1.0) -> None:
        """Fill a region with one colour times a shade.

        Args:
            outside_px: Signed distance from the region's edge, negative inside.
            color: The colour.
            shade: Its brightness.
        """
        cover = np.clip(0.5 - outside_px, 0, 1)
        tone = shade if isinstance(shade, np.ndarray) else np.full_like(cover, shade)
        paint = cv2.merge([tone * part for part in color])
        self.pixels = np.asarray(cv2.blendLinear(paint, self.pixels, cover, 1 - cover), np.float32)

    def darken(self, factor: FloatImage) -> None:
        """Multiply every pixel by a factor."""
        self.pixels = np.asarray(cv2.multiply(self.pixels, cv2.merge([factor] * 3)), np.float32)

    def cloud(self, cell_px: tuple[float, float]) -> FloatImage:
        """Return smooth noise of mean 0 and standard deviation 1, with cells of (width, height)."""
        height, width = self.x.shape
        cells = max(4, round(height / cell_px[1])), max(4, round(width / cell_px[0]))
        coarse = self.rng.standard_normal(cells).astype(np.float32)
        cloud = np.asarray(cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC), np.float32)
        return np.asarray(cloud / cloud.std(), np.float32)


def distance_map(width_px: int, height_px: int, center_px: Vec) -> FloatImage:
    """Return every pixel's distance from a point [px], (h, w)."""
    y, x = np.ogrid[:height_px, :width_px]
    return np.hypot(x - center_px[0], y - center_px[1]).astype(np.float32)


def vignette(size_px: tuple[int, int], loss: float) -> FloatImage:
    """Return the light that reaches each pixel, 1 in the middle, (h, w)."""
    y, x = np.ogrid[: size_px[1], : size_px[0]]
    middle = (size_px[0] - 1) / 2, (size_px[1] - 1) / 2
    corner = math.hypot(*middle)
    light: NDArray[np.float32] = (
        1 - loss * ((x - middle[0]) ** 2 + (y - middle[1]) ** 2) / corner**2
    ).astype(np.float32)
    return light


def shading_positions(distance: FloatImage, radius_px: float, shift: Vec) -> tuple[FloatImage, FloatImage]:
    """Return, for each pixel of the bowl, the position (x, y) at which a needle would shade it.

    The bowl is a hemisphere behind the section, so a shadow is displaced in proportion to the depth.

    Args:
        distance: Distance of every pixel from the bowl's centre [px], (h, w).
        radius_px: Radius of the bowl.
        shift: Displacement to the right and down, per depth.
    """
    depth = np.sqrt(np.clip(radius_px**2 - distance**2, 0, None))
    y, x = np.mgrid[: distance.shape[0], : distance.shape[1]]
    return (x - shift[0] * depth).astype(np.float32), (y - shift[1] * depth).astype(np.float32)


def rim_geometry(section: ImageGeometry, foot_px: Vec, share: float) -> ImageGeometry:
    """Return the image geometry of the cut wall.

    Args:
        section: Image geometry of the section.
        foot_px: The point on the section nearest to the camera.
        share: Distance of the wall in front of the section, as a share of the camera's distance.
    """
    if not share:
        return section
    larger, off = 1 / (1 - share), subtract(section.center_px, foot_px)
    center_px = foot_px[0] + larger * off[0], foot_px[1] + larger * off[1]
    return ImageGeometry(center_px, section.mm_per_px / larger, section.mirrored)


def paint_phantom(
    eye: Eye,
    image: ImageGeometry,
    rim: ImageGeometry,
    size_px: tuple[int, int],
    appearance: Appearance,
    seed: int,
) -> FloatImage:
    """Paint everything but the needle.

    Args:
        eye: The eye.
        image: Geometry of the image.
        rim: Image geometry of the cut wall, which may be in front of the eye frame's plane.
        size_px: (width, height).
        appearance: Style and texture.
        seed: Seed of stains, print lines and vessels.

    Returns:
        The background, (height, width, 3) BGR, 0 to 255, without blur, vignetting and noise.
    """
    canvas = _Canvas(*size_px, seed)
    palette = appearance.palette
    _paint_mask(canvas, palette, rim.center_px, eye.radius_mm / rim.mm_per_px, appearance.texture)
    _paint_globe(canvas, palette, eye, rim, appearance.texture)
    if eye.shape.retina_mm:
        _paint_layer(canvas, eye, image)
    if eye.shape.hemorrhage_mm:
        _paint_hemorrhage(canvas, image.to_px(eye.hemorrhage_mm), eye, image)
    for trocar_mm in (eye.trocar_mm, eye.other_trocar_mm):
        _paint_hole(canvas, palette, image.to_px(trocar_mm), eye, image, rim)
    return canvas.pixels


def _box(x: FloatImage, y: FloatImage, half_width: float, top: float, bottom: float) -> FloatImage:
    """Return the signed distance from an upright box."""
    return np.asarray(np.maximum(np.abs(x) - half_width, np.maximum(top - y, y - bottom)), np.float32)


def _paint_mask(canvas: _Canvas, palette: Palette, center: Vec, radius: float, texture: float) -> None:
    """Paint the surroundings of the globe: forehead roll, recess with tube, ledge with screws, cheeks."""
    x, y = canvas.x - center[0], canvas.y - center[1]
    canvas.fill(np.full_like(x, -1), palette.skin, 0.86 + 0.00006 * (300 - y))
    cheeks = np.maximum(2.12 * radius - np.abs(x), np.abs(y + 0.7 * radius) - 0.6 * radius)
    canvas.fill(np.maximum(cheeks, np.abs(x) - 2.3 * radius), palette.skin, 0.62)
    depth = np.clip((y + 1.2 * radius) / (0.9 * radius), 0, 1)
    recess = _box(x, y, 2.14 * radius, -1.2 * radius, -0.1 * radius)
    canvas.fill(recess, palette.recess, 0.72 + 0.35 * depth)
    height = np.clip((y + 2.0 * radius) / (0.9 * radius), 0, 1)
    corner_px = 0.12 * radius
    beside = np.maximum(np.abs(x) - 2.3 * radius + corner_px, 0)
    below = np.maximum(y + 1.12 * radius + corner_px, 0)
    bulge = 1.04 - 0.62 * np.clip(height - 0.3, 0, 1) ** 1.6
    canvas.fill(np.hypot(beside, below) - corner_px, palette.skin, bulge)
    _paint_tube(canvas, palette, x, y, radius)
    ledge = _box(x, y, 2.45 * radius, -0.24 * radius, 9 * radius)
    grain = canvas.cloud((240, 5)) * 0.4 + canvas.cloud((40, 9)) * 0.3 + canvas.cloud((60, 30)) * 0.4
    canvas.fill(ledge, palette.ledge, 1 + 0.025 * texture * grain)
    canvas.fill(_box(x, y, 2.45 * radius, -0.24 * radius, -0.232 * radius), palette.ledge, 1.15)
    for side in (-1.67, 1.67):
        distance = np.hypot(x - side * radius, y - 0.48 * radius)
        canvas.fill(distance - 0.13 * radius, palette.ledge, 0.72)
        dome = np.clip(1 - (distance / (0.095 * radius)) ** 2, 0, 1)
        canvas.fill(distance - 0.095 * radius, (128, 136, 140), 0.35 + 0.95 * dome)


def _paint_tube(canvas: _Canvas, palette: Palette, x: FloatImage, y: FloatImage, radius: float) -> None:
    half = 0.055 * radius
    across = (y + 0.82 * radius - math.tan(math.radians(4.2)) * x) / half
    ends = np.abs(x) - 2.17 * radius
    shadow = np.clip(1.4 - np.abs(across - 1.8), 0, 1) * np.clip(0.5 - ends, 0, 1)
    canvas.darken((1 - 0.18 * shadow).astype(np.float32))
    round_shade = np.sqrt(np.clip(1 - across**2, 0, 1)) * 0.75 + 0.35 - 0.12 * across
    canvas.fill(np.maximum(ends, half * (np.abs(across) - 1)), palette.tube, round_shade.astype(np.float32))


def _paint_globe(canvas: _Canvas, palette: Palette, eye: Eye, image: ImageGeometry, texture: float) -> None:
    """Paint the cut wall and the bowl behind it."""
    scale = 1 / image.mm_per_px
    x, y = canvas.x - image.center_px[0], canvas.y - image.center_px[1]
    distance = np.hypot(x, y)
    inner, outer = eye.radius_mm * scale, (eye.radius_mm + eye.shape.wall_mm) * scale
    contact = np.clip((distance - outer) / (0.35 * inner), 0, 1)
    canvas.darken(np.where(y > -0.24 * inner, 0.74 + 0.26 * contact, 1).astype(np.float32))
    lines = canvas.cloud((900, 6)) * 0.7 + canvas.cloud((200, 40)) * 0.5
    canvas.fill(distance - outer, palette.wall, 1 + 0.02 * texture * lines - 0.05 * np.clip(y / outer, -1, 1))
    lit = np.clip((y / inner + 1) / 2, 0, 1)
    rim = np.clip((inner - distance) / (0.06 * inner), 0, 1)
    stains = 0.6 * canvas.cloud((150, 24)) + 0.6 * canvas.cloud((90, 70)) + 0.5 * lines
    shade = palette.bowl_shade + (1.06 - palette.bowl_shade) * lit
    shade = shade * (0.9 + 0.1 * rim) * (1 + 0.022 * texture * stains)
    canvas.fill(distance - inner, palette.bowl, shade)
    if palette.fundus is not None:
        _paint_fundus(canvas, palette, distance - inner, y / inner, shade, image.center_px)


def _paint_fundus(
    canvas: _Canvas,
    palette: Palette,
    outside_bowl: FloatImage,
    height: FloatImage,
    shade: FloatImage,
    center: Vec,
) -> None:
    """Paint the red of the retina and its vessels over the lower part of the bowl."""
    border_px = 400 * (0.43 - height - 0.02 * canvas.cloud((20, 20)))
    soft = np.maximum(outside_bowl, border_px / 40)
    canvas.fill(soft, palette.fundus or palette.bowl, shade)
    inner = float(-outside_bowl.min())
    for _ in range(14):
        vessel = np.zeros(height.shape, np.uint8)
        corners = np.round((_vessel(canvas.rng, inner) + np.asarray(center)) * 16).astype(np.int32)
        cv2.polylines(vessel, [corners], False, 255, thickness=3, lineType=cv2.LINE_AA, shift=4)
        left, top, wide, high = cv2.boundingRect(vessel)
        part = np.s_[top : top + high, left : left + wide]
        strength = 0.6 * vessel[part].astype(np.float32)[..., None] / 255
        canvas.pixels[part] += strength * (np.asarray(palette.vessel, np.float32) - canvas.pixels[part])


def _paint_layer(canvas: _Canvas, eye: Eye, image: ImageGeometry) -> None:
    """Paint a retina that is a layer in front of the wall."""
    x, y = canvas.x - image.center_px[0], canvas.y - image.center_px[1]
    half, radius = math.radians(eye.shape.retina_half_deg), eye.radius_mm / image.mm_per_px
    distance, turn = np.hypot(x, y), np.abs(np.arctan2(x, y))
    thick = eye.shape.retina_mm / image.mm_per_px
    outside = np.maximum(np.maximum(distance - radius, radius - thick - distance), (turn - half) * radius)
    canvas.fill(outside.astype(np.float32), LAYER, 1 + 0.02 * canvas.cloud((60, 30)))


def _paint_hemorrhage(canvas: _Canvas, at_px: Vec, eye: Eye, image: ImageGeometry) -> None:
    """Paint blood on the retina: a flat mound."""
    outwards = unit(subtract(at_px, image.center_px))
    x, y = canvas.x - at_px[0], canvas.y - at_px[1]
    along, across = x * outwards[0] + y * outwards[1], y * outwards[0] - x * outwards[1]
    half = eye.shape.hemorrhage_mm / 2 / image.mm_per_px
    mound = (np.hypot(along / (HEMORRHAGE_HEIGHT * half), across / half) - 1) * HEMORRHAGE_HEIGHT * half
    beyond = (
        np.hypot(canvas.x - image.center_px[0], canvas.y - image.center_px[1])
        - eye.radius_mm / image.mm_per_px
    )
    canvas.fill(np.maximum(mound, beyond), BLOOD, 1 + 0.12 * canvas.cloud((20, 20)))


def _vessel(rng: np.random.Generator, inner: float) -> NDArray[np.float64]:
    """Return a winding curve in the lower half of the bowl, relative to its centre, (n, 2)."""
    steps = 60
    turn = np.cumsum(rng.normal(0, 0.18, steps)) + rng.uniform(0, 2 * math.pi)
    walk = np.stack([np.cumsum(np.cos(turn)), np.cumsum(np.sin(turn))], axis=1) * inner * 0.014
    start = np.array([rng.uniform(-0.7, 0.7), rng.uniform(0.15, 0.8)]) * inner
    points = start + walk
    is_inside = (np.hypot(*points.T) < 0.93 * inner) & (points[:, 1] > 0.02 * inner)
    return np.asarray(points[is_inside], np.float64)


def _paint_hole(
    canvas: _Canvas, palette: Palette, trocar: Vec, eye: Eye, image: ImageGeometry, rim: ImageGeometry
) -> None:
    """Paint a port opening on the bowl.

    Its centre is in the section; its height follows from how perspective foreshortens the bowl in depth.
    """
    center, scale, half_width_mm = image.center_px, 1 / image.mm_per_px, 0.6
    before_mm, half_height_mm = 0.12, 0.16  # chosen by eye for a wall in the plane of the section
    if eye.shape.rim_mm:
        distance_mm = eye.shape.rim_mm / (1 - rim.mm_per_px / image.mm_per_px)
        before_mm, half_height_mm = 0.0, eye.radius_mm * half_width_mm / distance_mm
    outwards = unit(subtract(trocar, center))
    reach = (eye.radius_mm - before_mm) * scale
    x, y = canvas.x - center[0] - outwards[0] * reach, canvas.y - center[1] - outwards[1] * reach
    along = x * outwards[0] + y * outwards[1]
    across = -x * outwards[1] + y * outwards[0]
    half_width, half_height = half_width_mm * scale, half_height_mm * scale
    ellipse = (np.hypot(along / half_height, across / half_width) - 1) * half_height
    inside = (
        np.hypot(canvas.x - rim.center_px[0], canvas.y - rim.center_px[1]) - eye.radius_mm / rim.mm_per_px
    )
    canvas.fill(np.maximum(ellipse, inside), palette.hole)
