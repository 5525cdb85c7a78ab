"""B-scans for tests: a perceiver for each, its results in pixels, and bevels whose point is on the far wall."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

import numpy as np
from msgspec.structs import replace

from haptigraph.config import PerceptionConfig
from haptigraph.perception.oct.bscan import BscanPerceiver
from haptigraph.registration.loading import parse_registration
from haptigraph.sim.oct import bscan
from haptigraph.sim.oct.appearance import intensity
from haptigraph.sim.oct.bscan import Bscan
from haptigraph.sim.oct.needle import NeedlePx, needle_level
from haptigraph.sim.oct.scenes import BscanScene

__all__ = [
    "in_px",
    "line_distance_px",
    "perceiver_of",
    "registration_of",
    "scan_of_bevel",
    "visible_columns_of",
]


def registration_of(width, height, axial_mm, lateral_mm, mirrored="false"):
    return parse_registration(
        f"format = 1\n[image]\nwidth = {width}\nheight = {height}\nmirrored = {mirrored}\n[scale]\n"
        f"axial_mm_per_px = {axial_mm}\nlateral_mm_per_px = {lateral_mm}\n",
        "registration.toml",
    )


def perceiver_of(scene, size_px=None):
    """A perceiver for a scene, resampled to another size if one is given, and its image's geometry."""
    scan, (width, height) = scene.scan, size_px or (scene.scan.width_px, scene.scan.height_px)
    axial_mm = scan.axial_mm_per_px * scan.height_px / height
    registration = registration_of(width, height, axial_mm, scan.lateral_mm_per_px * scan.width_px / width)
    return BscanPerceiver(registration, PerceptionConfig()), registration.image


def in_px(found, name, image):
    return np.array([image.to_px(point) for point in found[name].points_mm]).T


def visible_columns_of(observation, name, x, image):
    """The columns in which a surface is visible itself, not interpolated."""
    is_visible = np.ones(len(x), bool)
    for part in observation.interpolated.get(name, ()):
        left, right = (image.to_px((end, 0.0))[0] for end in part)
        is_visible &= (x <= left + 1e-6) | (x >= right - 1e-6)
    return is_visible


def line_distance_px(observation, image, point_px):
    """Distance of a point from the line of the shaft."""
    line = observation.found["needle_line"]
    (x, y), (end_x, end_y) = image.to_px(line.start_mm), image.to_px(line.end_mm)
    across = (end_x - x) * (point_px[1] - y) - (end_y - y) * (point_px[0] - x)
    return abs(across) / math.hypot(end_x - x, end_y - y)


def scan_of_bevel(scene: BscanScene, drop_px: float, before_px: float, number: int = 0) -> Bscan:
    """Render a scene whose tip is so far below the shaft's line.

    Args:
        scene: The scene; its truth has the tip, and the shaft's direction.
        drop_px: Along the beam, from the shaft's line to the tip.
        before_px: Columns by which the line ends before the tip's.
        number: Chooses the speckle.
    """
    with _far_wall(drop_px, before_px):
        return scene.take(number=number)


@contextmanager
def _far_wall(drop_px: float, before_px: float) -> Iterator[None]:
    """Draw the metal as a line above the tip, and the tip as a bright spot."""

    def level(needle: NeedlePx, style, ilm_px, size_px):
        (x, y), (dx, dy) = needle.tip_px, needle.along_px
        end = x - np.sign(dx) * before_px, y - drop_px - before_px * dy / abs(dx)
        line = needle_level(NeedlePx(end, needle.along_px), replace(style, bevel_px=0.0), ilm_px, size_px)
        radius_px = style.width_px
        columns, rows = np.arange(size_px[0]), np.arange(size_px[1])[:, None]
        away = ((columns - x) ** 2 + (rows - y + radius_px) ** 2) / radius_px**2
        return np.asarray(line + intensity(style.bright_db * (1 - 0.5 * away)), np.float32)

    with patch.object(bscan, "needle_level", level):
        yield
