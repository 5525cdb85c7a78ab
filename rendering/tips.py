"""What is rendered of scenes drawn by lot: a scene -> needles' poses, and the part about each tip.

The tip network learns from them. Each needle is rendered only as far as the window that the network reads, so
that many scenes take little time.
"""

import math
from pathlib import Path
from typing import TypeAlias

import numpy as np

from haptigraph.geometry import norm
from rendering.layout import HEIGHT_PX, WIDTH_PX, Box, Layout, Placed
from rendering.path import BEYOND_MM, Pose
from rendering.scene import OUTPUT

__all__ = ["AROUND", "EMPTY", "FOLDER", "SMALLER", "Part", "box_px", "file_of", "parts_of", "poses_of"]

FOLDER = OUTPUT.parent / "tips"
"""A folder for each scene, with an image of each needle, of the empty eye there, and of all around it."""
AROUND, EMPTY = "around", "empty"
"""Names of the images without needle."""
Part: TypeAlias = tuple[Pose | None, Box | None]
"""The pose of its needle, and the part of the image; None: none, and all of it."""

DEEP, NEAR_RETINA, NEAR_MM = 8, 4, 1.5  # numbers of needles, and how near the second ones are
FIRST_MM, MAX_THETA_DEG = 0.8, 8.0
BEHIND_MM, BEYOND_TIP_MM, ASIDE_MM = 9.5, 4.5, 1.3  # of the rendered part about a tip
EVEN_PX = 16  # corners are multiples of this, so that compression and halving fit
SMALLER = 4
"""The surroundings are rendered at this fraction of their size."""


def poses_of(layout: Layout) -> list[Pose]:
    """Return the poses of the needles in a drawn scene whose tips are visible inside."""
    rng = np.random.default_rng([27, layout.scene.seed])
    last_mm = norm(layout.axis_mm) + BEYOND_MM
    depths_mm = *rng.uniform(FIRST_MM, last_mm, DEEP), *rng.uniform(last_mm - NEAR_MM, last_mm, NEAR_RETINA)
    poses = [
        Pose(float(depth_mm), float(rng.uniform(-MAX_THETA_DEG, MAX_THETA_DEG)))
        if depth_mm < last_mm - NEAR_MM
        else Pose(float(depth_mm), float(rng.normal(0, 0.2)))
        for depth_mm in depths_mm
    ]
    placed = [layout.placed(pose) for pose in poses]
    return [
        pose
        for pose, each in zip(poses, placed, strict=True)
        if layout.is_visible(each) and layout.is_inside(each)
    ]


def box_px(layout: Layout, placed: Placed) -> Box:
    """Return the part of the image about a tip that is rendered: left, top, right, bottom."""
    (x, y), (dx, dy) = placed.axis_mm, placed.direction
    corners = [
        layout.to_px((x + along * dx - aside * dy, y + along * dy + aside * dx))
        for along in (-BEHIND_MM, BEYOND_TIP_MM)
        for aside in (-ASIDE_MM, ASIDE_MM)
    ]
    columns, rows = zip(*corners, strict=True)
    return (
        max(math.floor(min(columns) / EVEN_PX) * EVEN_PX, 0),
        max(math.floor(min(rows) / EVEN_PX) * EVEN_PX, 0),
        min(math.ceil(max(columns) / EVEN_PX) * EVEN_PX, WIDTH_PX),
        min(math.ceil(max(rows) / EVEN_PX) * EVEN_PX, HEIGHT_PX),
    )


def parts_of(layout: Layout) -> dict[str, Part]:
    """Return what is rendered of a drawn scene, by the names of the images; the needles come last."""
    poses = poses_of(layout)
    boxes = [box_px(layout, layout.placed(pose)) for pose in poses]
    needles = {f"{number:02d}": part for number, part in enumerate(zip(poses, boxes, strict=True))}
    left, top, right, bottom = zip(*boxes, strict=True)
    return {AROUND: (None, None), EMPTY: (None, (min(left), min(top), max(right), max(bottom))), **needles}


def file_of(number: int, name: str) -> Path:
    """Return the file of one image of a drawn scene."""
    return FOLDER / f"{number:04d}" / f"{name}.webp"
