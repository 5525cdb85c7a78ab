"""A strip of the image along an expected shaft, laid straight, with the empty eye taken away.

Turns an image (px) and an expected line through the trocar into rows along the shaft (`u_px`, from the
trocar's foot, into the eye) and columns across it (`v_px`). Knows which rows a needle could be seen in, and
no needle.
"""

import math
from typing import Any

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.geometry import Vec, norm, subtract
from haptigraph.messages import Image
from haptigraph.perception.pixels import FloatImage, Mask, grey_of
from haptigraph.perception.registration import Registration

__all__ = ["ROW_PX", "UNSEEN", "Line", "Site", "Strip", "lay_straight", "median", "row_sums", "sample_strip"]

UNSEEN = -1e5
"""Marks pixels of the empty eye that were never seen without a needle."""

ROW_PX = 2.0
"""From row to row of a strip."""

OUTSIDE_MM = 12.0  # how far beyond the trocar the shaft is looked at
HALF_WIDTH_MM = 0.5  # of the thickest needle
MARGIN_PX = 6
FLANK_PX = 4
RIM_PX = 1.5
WALL_MARGIN_MM = 0.1
BEYOND_MM = 0.5  # past the far wall: a tip may be pushed into the retina
GAIN_RANGE = (0.5, 2.0)


class Line(Struct, frozen=True):
    """A directed line in the image, by the trocar."""

    angle_rad: float
    """Of the direction into the eye; 0 along x, pi/2 along y (down)."""
    offset_px: float
    """At which it passes the registered trocar, along the normal (the direction turned by +90 degrees)."""

    @property
    def direction(self) -> Vec:
        """Into the eye, length 1."""
        return math.cos(self.angle_rad), math.sin(self.angle_rad)

    @property
    def normal(self) -> Vec:
        """Across the line, length 1."""
        return -math.sin(self.angle_rad), math.cos(self.angle_rad)

    def at_px(self, trocar_px: Vec, along_px: float) -> Vec:
        """Return the place so far along the line from the trocar's foot."""
        (dx, dy), (nx, ny) = self.direction, self.normal
        return (
            trocar_px[0] + self.offset_px * nx + along_px * dx,
            trocar_px[1] + self.offset_px * ny + along_px * dy,
        )


class Site:
    """The static places a tracker needs, in pixels.

    The trocar is registered in the middle of the wall, so the wall is as thick outside of it as inside.

    Args:
        registration: Where the static anatomy lies.
    """

    def __init__(self, registration: Registration) -> None:
        image = registration.image
        self.registration = registration
        self.px_per_mm = 1 / image.mm_per_px
        self.width_px, self.height_px = registration.width_px, registration.height_px
        self.trocar_px = image.to_px(registration.trocar.at_mm)
        self.center_px = image.center_px
        self.inner_px = registration.globe.radius_mm * self.px_per_mm
        trocar_radius = norm(subtract(self.trocar_px, self.center_px))
        self.outer_px = 2 * max(trocar_radius, self.inner_px) - self.inner_px
        self.outer_px += WALL_MARGIN_MM * self.px_per_mm
        self.inwards_rad = math.atan2(
            self.center_px[1] - self.trocar_px[1], self.center_px[0] - self.trocar_px[0]
        )
        self.half_px = math.ceil(HALF_WIDTH_MM * self.px_per_mm) + MARGIN_PX
        columns = 2 * self.half_px + 1
        ends = np.zeros((columns, 2), np.float32)
        ends[:FLANK_PX, 0] = ends[-FLANK_PX:, 1] = 1 / FLANK_PX
        ramp = np.linspace(0, 1, columns, dtype=np.float32)
        level = np.eye(columns, dtype=np.float32) - ends @ np.stack([1 - ramp, ramp])
        self.level = np.column_stack([level, ends.sum(axis=1)])
        """Takes from a row the straight ramp between its two ends, and puts their sum behind it,
        (columns, columns + 1)."""

    def wall_px(self, line: Line) -> tuple[float, float, float] | None:
        """Return where a line enters and leaves the wall and meets the far side; None if it misses."""
        inner, outer = self._crossings_px(line, self.inner_px), self._crossings_px(line, self.outer_px)
        return (outer[0], *inner) if inner and outer else None

    def _crossings_px(self, line: Line, radius_px: float) -> tuple[float, float] | None:
        """Return where a line enters and leaves a circle about the globe's centre; None if it misses it."""
        to_center = subtract(self.center_px, line.at_px(self.trocar_px, 0.0))
        along = to_center[0] * line.direction[0] + to_center[1] * line.direction[1]
        squared = radius_px**2 - norm(to_center) ** 2 + along**2
        return (along - math.sqrt(squared), along + math.sqrt(squared)) if squared > 0 else None

    def first_px(self, line: Line) -> float:
        """Return where, seen from the trocar outwards, a line leaves the image or what is looked at."""
        start = -OUTSIDE_MM * self.px_per_mm
        foot = line.at_px(self.trocar_px, 0.0)
        for place, step, size in zip(foot, line.direction, (self.width_px, self.height_px), strict=True):
            if abs(step) > 1e-9:
                start = max(start, -place / step if step > 0 else (size - 1 - place) / step)
        return start


class Strip(Struct, frozen=True, eq=False):
    """Straightened pixels along an expected line."""

    u_px: FloatImage
    """Where each row lies along the line, (n,), ROW_PX apart."""
    half_px: int
    """Columns reach so far to either side."""
    excess: FloatImage
    """What differs from the empty eye and from the flanks, grey levels, (n, 2 half_px + 1)."""
    beside: FloatImage
    """What differs from the flanks alone, same shape."""
    is_known: Mask
    """Rows where the empty eye is known, (n,)."""
    before: slice
    """Rows before the wall."""
    inside: slice
    """Rows within the globe; rows in the wall are in neither."""
    noise_grey: float
    """Standard deviation of a pixel of `excess` without needle."""


def sample_strip(
    site: Site,
    image: Image,
    empty: FloatImage,
    expected: Line,
    from_px: float = -math.inf,
    until_px: float = math.inf,
) -> Strip | None:
    """Lay the surroundings of an expected line straight.

    Args:
        site: Where things are.
        image: (h, w, 3) BGR or (h, w) grey.
        empty: The eye without needle, (h, w) grey; negative where not known.
        expected: The line.
        from_px: Where along the line to start at the earliest.
        until_px: Where along the line to stop at the latest.

    Returns:
        The strip, or None if the line misses the globe.
    """
    wall = site.wall_px(expected)
    if wall is None:
        return None
    outer, inner, far = wall
    scale = site.px_per_mm
    last = max(min(far + BEYOND_MM * scale, until_px), inner + 2 * scale)
    first = math.ceil(max(min(site.first_px(expected) + 1, outer), min(from_px, last - 2 * scale)))
    return lay_straight(site, image, empty, expected, np.arange(first, last, ROW_PX, dtype=np.float32))


def lay_straight(site: Site, image: Image, empty: FloatImage, line: Line, u_px: FloatImage) -> Strip | None:
    """Lay the surroundings of a part of a line straight.

    Args:
        site: Where things are.
        image: (h, w, 3) BGR or (h, w) grey.
        empty: The eye without needle, (h, w) grey; negative where not known.
        line: The line.
        u_px: Evenly spaced places along it, (n,), two at least.

    Returns:
        The strip, or None if the line misses the globe.
    """
    wall = site.wall_px(line)
    if wall is None:
        return None
    grey = grey_of(np.asarray(_warp(site, image, line, u_px), np.uint8)).astype(np.float32) @ site.level
    without = np.asarray(_warp(site, empty, line, u_px), np.float32)
    is_known = np.asarray(without.min(axis=1) >= 0)
    without = without @ site.level
    without *= (is_known * np.float32(_gain(grey, without, is_known)))[:, None]
    columns = slice(0, 2 * site.half_px + 1)
    excess = (grey - without)[:, columns]
    first, step = float(u_px[0]), float(u_px[1] - u_px[0])
    bounds = wall[0], wall[1] + RIM_PX, wall[2] - RIM_PX
    outer, inner, far = (min(max(round((bound - first) / step), 0), len(u_px)) for bound in bounds)
    return Strip(
        u_px,
        site.half_px,
        excess,
        grey[:, columns],
        is_known,
        slice(0, outer),
        slice(inner, far),
        _deviation(excess[::3, FLANK_PX : 2 * FLANK_PX]),
    )


def _warp(site: Site, image: Image | FloatImage, line: Line, u_px: FloatImage) -> NDArray[Any]:
    (nx, ny), (dx, dy) = line.normal, line.direction
    x, y = line.at_px(site.trocar_px, float(u_px[0]))
    corner = x - site.half_px * nx, y - site.half_px * ny
    step = float(u_px[1] - u_px[0])
    image_from_strip = np.array([[nx, step * dx, corner[0]], [ny, step * dy, corner[1]]])
    size = 2 * site.half_px + 1, len(u_px)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(
        cv2.warpAffine(image, image_from_strip, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    )


def _gain(grey: FloatImage, without: FloatImage, rows: Mask) -> float:
    """Estimate how much brighter the light is than it was for the empty eye, from the flanks."""
    now, then = float(grey[:, -1] @ rows), float(without[:, -1] @ rows)
    return min(max(now / then, GAIN_RANGE[0]), GAIN_RANGE[1]) if then > 0 else 1.0


def row_sums(rows: FloatImage, weights: FloatImage) -> FloatImage:
    """Return every row's weighted sum.

    Not `@`: on narrow rows OpenBLAS reads past their ends and raises false alarms of invalid values.
    """
    return np.asarray(np.einsum("ij,j->i", rows, weights), np.float32)


def _deviation(values: FloatImage) -> float:
    """Return a robust standard deviation, at least that of rounding."""
    return max(0.5, 1.4826 * median(np.abs(values))) if values.size else 3.0


def median(values: NDArray[Any]) -> float:
    """Return the (upper) median; ten times as fast as numpy's on few values."""
    return float(np.partition(values, values.size // 2, axis=None)[values.size // 2])
