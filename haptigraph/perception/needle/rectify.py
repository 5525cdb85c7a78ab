"""Rectification: a strip of the image along an expected shaft, with the background subtracted.

Turns an image (px) and an expected line through the trocar into stations along the shaft (`u_px`, from the
trocar's foot, into the eye) and lanes across it (`v_px`): a row of the strip is a lane, a column a station.
Also where a needle can be visible along a line.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.geometry import Vec, norm, subtract
from haptigraph.imaging import FloatImage, Mask
from haptigraph.messages import Image
from haptigraph.perception.native.rectification import Positions, strip_positions, subtract_background
from haptigraph.perception.native.strip import STATION_PX, RectifiedStrip
from haptigraph.registration.camera import Registration

__all__ = [
    "MAX_TURN_RAD",
    "RIM_MISS_MM",
    "STATION_PX",
    "UNOBSERVED",
    "EyeGeometry",
    "Line",
    "RectifiedStrip",
    "median",
    "rectify",
    "stations",
]

UNOBSERVED = -1e5
"""Marks pixels of the background that were never visible without a needle."""

MAX_TURN_RAD = math.radians(46)
"""Between a needle and the direction from its trocar to the globe's centre."""

OUTSIDE_MM = 12.0  # how far outside the trocar the shaft is searched and followed
HALF_WIDTH_MM = 0.5  # of the thickest needle
MARGIN_PX = 6
RIM_PX = 1.5
FAR_PX = 1.0  # beyond the far wall's edge a tip that touches it may still be visible
WALL_MARGIN_MM = 0.1
RIM_MISS_MM = 0.6
"""Between the registered rim and the actual one."""
BEYOND_MM = 0.5  # past the far wall: a tip may be pushed into the retina
INSIDE_MM = 4.0  # of the shortest strip: a needle that comes out of the longest cannula


class Line(Struct, frozen=True):
    """A directed line in the image, by the trocar."""

    angle_rad: float
    """Of the direction into the eye; 0 along x, pi/2 along y (down)."""
    offset_px: float
    """From the registered trocar, along the normal (the direction turned by +90 degrees)."""

    @property
    def direction(self) -> Vec:
        """Into the eye, length 1."""
        return math.cos(self.angle_rad), math.sin(self.angle_rad)

    @property
    def normal(self) -> Vec:
        """Across the line, length 1."""
        dx, dy = self.direction
        return -dy, dx

    def at_px(self, trocar_px: Vec, along_px: float) -> Vec:
        """Return the point so far along the line from the trocar's foot."""
        (x, y), dx, dy = trocar_px, math.cos(self.angle_rad), math.sin(self.angle_rad)
        return x - self.offset_px * dy + along_px * dx, y + self.offset_px * dx + along_px * dy


class EyeGeometry:
    """The static geometry that a tracker needs, in pixels.

    The trocar is registered in the middle of the wall, so the wall is as thick outside it as inside.

    Args:
        registration: The static anatomy.
    """

    def __init__(self, registration: Registration) -> None:
        image = registration.image
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

    def bands(self, count: int) -> list[tuple[slice, slice]]:
        """Return bands of rows, and the columns in each, that strips can reach, from top to bottom.

        They reach the globe, and the cone before the trocar.
        """
        radius = self.inner_px + BEYOND_MM * self.px_per_mm
        cone = [
            Line(self.inwards_rad + turn_rad, 0.0).at_px(self.trocar_px, -OUTSIDE_MM * self.px_per_mm)
            for turn_rad in (-MAX_TURN_RAD, 0.0, MAX_TURN_RAD)
        ]
        sides = [(self.center_px[0] + side * radius, self.center_px[1] + side * radius) for side in (-1, 1)]
        x, y = zip(*sides, *cone, strict=True)
        rows, columns = _span(y, self.half_px, self.height_px), _span(x, self.half_px, self.width_px)
        reach, margin_px = np.zeros((self.height_px, self.width_px), np.uint8), 2 * self.half_px
        corners = np.rint([self.trocar_px, *cone]).astype(np.int32)
        cv2.fillPoly(reach, [corners], 1)
        cv2.polylines(reach, [corners], True, 1, 2 * margin_px)
        center = round(self.center_px[0]), round(self.center_px[1])
        cv2.circle(reach, center, round(radius) + margin_px, 1, cv2.FILLED)
        edges = [rows.start + band * (rows.stop - rows.start) // count for band in range(count + 1)]
        bands = []
        for start, stop in pairwise(edges):
            reached = np.flatnonzero(reach[start:stop, columns].any(axis=0)) + columns.start
            across = slice(int(reached[0]), int(reached[-1]) + 1) if len(reached) else slice(0, 0)
            bands.append((slice(start, stop), across))
        return bands

    def is_inside(self) -> Mask:
        """Return the pixels within the globe's outer wall, (height_px, width_px)."""
        y, x = np.ogrid[: self.height_px, : self.width_px]
        (center_x, center_y), radius = self.center_px, self.outer_px
        return np.asarray((x - center_x) ** 2 + (y - center_y) ** 2 < radius**2, np.bool_)

    def rays(self, radius_px: NDArray[Any], count: int) -> tuple[tuple[FloatImage, FloatImage], Mask]:
        """Return positions along rays from the globe's centre, and which rays are in view.

        Args:
            radius_px: (n,), distances from the centre.
            count: Of rays, all around.

        Returns:
            x and y, (count, n) each, and a mask, (count,).
        """
        angle_rad = np.linspace(0, 2 * np.pi, count, endpoint=False)[:, None]
        x = self.center_px[0] + radius_px * np.cos(angle_rad)
        y = self.center_px[1] + radius_px * np.sin(angle_rad)
        in_view = (x >= 0) & (y >= 0) & (x <= self.width_px - 1) & (y <= self.height_px - 1)
        return (x.astype(np.float32), y.astype(np.float32)), np.asarray(in_view.all(axis=1), np.bool_)

    def wall_px(self, line: Line) -> tuple[float, float, float] | None:
        """Return where a line enters and leaves the wall and meets the far side; None if it misses."""
        (dx, dy), foot = line.direction, line.at_px(self.trocar_px, 0.0)
        x, y = self.center_px[0] - foot[0], self.center_px[1] - foot[1]
        along, off_axis = x * dx + y * dy, x * dy - y * dx
        if abs(off_axis) >= self.inner_px:
            return None
        outer = math.sqrt(self.outer_px**2 - off_axis**2)
        inner = math.sqrt(self.inner_px**2 - off_axis**2)
        return along - outer, along - inner, along + inner

    def first_px(self, line: Line) -> float:
        """Return where, from the trocar outwards, a line leaves the image or the part that is searched."""
        start = -OUTSIDE_MM * self.px_per_mm
        foot = line.at_px(self.trocar_px, 0.0)
        for at, step, size in zip(foot, line.direction, (self.width_px, self.height_px), strict=True):
            if abs(step) > 1e-9:
                start = max(start, -at / step if step > 0 else (size - 1 - at) / step)
        return start


def _span(values_px: Sequence[float], margin_px: int, size_px: int) -> slice:
    """Return the part of an image's side that holds some values and a margin about them."""
    first, last = math.floor(min(values_px)) - margin_px, math.ceil(max(values_px)) + margin_px + 1
    return slice(max(first, 0), min(last, size_px))


def stations(
    eye: EyeGeometry, line: Line, from_px: float = -math.inf, until_px: float = math.inf
) -> FloatImage | None:
    """Return the positions along a line at which a shaft can be visible, (n,).

    Args:
        eye: The eye's geometry.
        line: The line.
        from_px: Where along the line to start at the earliest.
        until_px: Where along the line to stop at the latest.

    Returns:
        The positions, or None if the line misses the globe.
    """
    wall = eye.wall_px(line)
    if wall is None:
        return None
    outer, inner, far = wall
    scale = eye.px_per_mm
    last = max(min(far + BEYOND_MM * scale, until_px), inner + INSIDE_MM * scale)
    first = math.ceil(max(min(eye.first_px(line) + 1, outer), min(from_px, last - 2 * scale)))
    return np.arange(first, last, STATION_PX, dtype=np.float32)


def rectify(
    eye: EyeGeometry,
    image: Image,
    background: FloatImage,
    line: Line,
    *runs_px: FloatImage,
    chroma: FloatImage | None = None,
    chroma_share: float = 0.0,
    light: float = 1.0,
) -> list[RectifiedStrip] | None:
    """Rectify the image along one or more parts of a line, all at once, and subtract the background.

    Args:
        eye: The eye's geometry.
        image: (h, w, 3) BGR or (h, w) grey.
        background: The eye without needle, (h, w) grey; negative where unknown.
        line: The line.
        runs_px: Evenly spaced positions along it, (n,) each, two at least.
        chroma: How much bluer than red the eye is without needle, (h, w); None to go by the grey alone.
        chroma_share: Of blue less red in the grey within the globe, as in that of `background`.
        light: How many times brighter the strips are than the image.

    Returns:
        A strip of each run, or None if the line misses the globe.

    Raises:
        ValueError: If an image is of another type, or a position not finite or far from the image.
    """
    wall = eye.wall_px(line)
    if wall is None:
        return None
    u_px = runs_px[0] if len(runs_px) == 1 else np.concatenate(runs_px)
    (dx, dy), foot_px = line.direction, line.at_px(eye.trocar_px, 0.0)
    positions = strip_positions(eye.half_px, u_px, foot_px, (-dy, dx), (dx, dy))
    pixels = _sampled(image, positions)
    ground = {"background": background}
    if chroma is not None and image.ndim == 3:
        ground["chroma"] = chroma
    planes = np.empty((len(ground) + 1, *pixels.shape[:2]), np.float32)
    for name, plane in zip(ground, planes[::2], strict=True):  # between them is room for what is detrended
        if _sampled(ground[name], positions, plane) is not plane:
            raise ValueError(f"{name}: expected float32, found {ground[name].dtype}")
    outer, inner, far = wall
    globe_px = outer, far + inner - outer
    is_known, noise_grey = subtract_background(pixels, planes, u_px, chroma_share, globe_px, light)
    strips, start = [], 0
    for run_px in runs_px:
        part = slice(start, start + len(run_px))
        sides, known = _sides(run_px, wall), is_known[part]
        strips.append(RectifiedStrip(run_px, eye.half_px, planes[:, :, part], known, *sides, noise_grey))
        start = part.stop
    return strips


def _sampled(image: NDArray[Any], positions: Positions, into: FloatImage | None = None) -> NDArray[Any]:
    return cv2.remap(image, *positions, cv2.INTER_LINEAR, into, cv2.BORDER_REPLICATE)


def _sides(u_px: FloatImage, wall_px: tuple[float, float, float]) -> tuple[slice, slice]:
    """Return the stations outside the wall, and those within the globe."""
    count, first = len(u_px), float(u_px[0])
    step, (outer, inner, far) = float(u_px[1]) - first, wall_px
    outer_end = min(max(round((outer - first) / step), 0), count)
    inner_start = min(max(round((inner + RIM_PX - first) / step), 0), count)
    inner_end = min(max(round((far + FAR_PX - first) / step), 0), count)
    return slice(0, outer_end), slice(inner_start, inner_end)


def median(values: NDArray[Any]) -> float:
    """Return the (upper) median; ten times as fast as numpy's on few values."""
    flat = values.flatten()
    middle = flat.size // 2
    flat.partition(middle)
    return float(flat[middle])
