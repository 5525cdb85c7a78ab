"""Static clutter on the bowl: winding vessels, and straight lines such as print lines and scratches."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.geometry import Vec
from haptigraph.imaging import FloatImage
from haptigraph.projection import ImageGeometry
from haptigraph.sim.eye.needle import blurred

__all__ = ["paint_lines", "paint_vessels"]

VESSEL_BGR = (0.55, 0.55, 0.8)  # share of the light that a vessel reflects
VESSEL_MM, LINE_MM = (0.1, 0.4), (0.08, 0.3)
LINE_LENGTH_MM = (3.0, 12.0)
LINE_CHANGES = (-0.35, 0.3)  # of the brightness: of the darkest and the brightest line
STEPS, STEP_MM, TURN_SD = 60, 0.2, 0.18
SHIFT = 4  # bits of sub-pixel

Points = NDArray[np.float64]


def paint_vessels(
    background: FloatImage,
    count: int,
    geometry: ImageGeometry,
    in_bowl: FloatImage,
    blur_px: float,
    seed: int,
) -> FloatImage:
    """Return a background with winding vessels on the bowl; more vessels leave the others as they are.

    Args:
        background: (h, w, 3).
        count: How many.
        geometry: Geometry of the image.
        in_bowl: Where the bowl is, 0 to 1, (h, w).
        blur_px: Standard deviation of the lens blur.
        seed: Seed of their paths and widths.
    """
    vessels = np.zeros(in_bowl.shape, np.float32)
    for number in range(count):
        rng = np.random.default_rng((seed, 12, number))
        turn = np.cumsum(rng.normal(0, TURN_SD, STEPS)) + rng.uniform(0, 2 * math.pi)
        walk = STEP_MM * np.cumsum(np.stack([np.cos(turn), np.sin(turn)], axis=1), axis=0)
        points_px = _start_px(rng, geometry, in_bowl) + walk / geometry.mm_per_px
        np.maximum(vessels, _drawn(points_px, rng.uniform(*VESSEL_MM), geometry, in_bowl), out=vessels)
    cover = blurred(vessels * in_bowl, blur_px)[..., None]
    return np.asarray(background * (1 - cover * (1 - np.array(VESSEL_BGR, np.float32))), np.float32)


def paint_lines(
    background: FloatImage,
    count: int,
    geometry: ImageGeometry,
    in_bowl: FloatImage,
    blur_px: float,
    seed: int,
) -> FloatImage:
    """Return a background with straight lines on the bowl, dark or bright; for arguments see vessels."""
    factor = np.ones(in_bowl.shape, np.float32)
    for number in range(count):
        rng = np.random.default_rng((seed, 13, number))
        start_px, turn = _start_px(rng, geometry, in_bowl), rng.uniform(0, 2 * math.pi)
        length_px = rng.uniform(*LINE_LENGTH_MM) / geometry.mm_per_px
        end_px = start_px + length_px * np.array([math.cos(turn), math.sin(turn)])
        line = _drawn(np.stack([start_px, end_px]), rng.uniform(*LINE_MM), geometry, in_bowl)
        factor *= 1 + rng.uniform(*LINE_CHANGES) * line * in_bowl
    return np.asarray(background * blurred(factor, blur_px)[..., None], np.float32)


def _start_px(rng: np.random.Generator, geometry: ImageGeometry, in_bowl: FloatImage) -> Points:
    """Return a random point of the bowl."""
    radius_px = math.sqrt(float(in_bowl.sum()) / math.pi)
    turn, reach_px = rng.uniform(0, 2 * math.pi), radius_px * math.sqrt(rng.uniform(0, 0.9))
    center: Vec = geometry.center_px
    return np.array([center[0] + reach_px * math.cos(turn), center[1] + reach_px * math.sin(turn)])


def _drawn(points_px: Points, width_mm: float, geometry: ImageGeometry, in_bowl: FloatImage) -> FloatImage:
    """Return where a polyline of a width is, 0 to 1; one thinner than a pixel is fainter instead."""
    width_px = width_mm / geometry.mm_per_px
    thickness = max(round(width_px), 1)
    drawn = np.zeros(in_bowl.shape, np.uint8)
    corners = np.round(points_px * 2**SHIFT).astype(np.int32)
    cv2.polylines(drawn, [corners], False, 255, thickness, cv2.LINE_AA, SHIFT)
    return np.asarray(drawn * np.float32(min(width_px / thickness, 1) / 255), np.float32)
