"""A strip of the image along an expected shaft, laid straight, with the empty eye taken away.

Turns an image (px) and an expected line through the trocar into stations along the shaft (`u_px`, from the
trocar's foot, into the eye) and lanes across it (`v_px`): one row of the strip is a lane, one column a
station. Knows at which stations a needle could be seen, and no needle.
"""

import ctypes
import math
import struct
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import force_setattr
from numpy.typing import NDArray

from haptigraph.geometry import Vec, norm, subtract
from haptigraph.imaging import FloatImage, Mask
from haptigraph.messages import Image
from haptigraph.perception.native.library import address, function, rows
from haptigraph.registration.camera import Registration

__all__ = [
    "LARGEST_TURN_RAD",
    "STATION_PX",
    "UNOBSERVED",
    "Line",
    "RectifiedStrip",
    "Site",
    "median",
    "rectify",
    "stations",
]

UNOBSERVED = -1e5
"""Marks pixels of the empty eye that were never seen without a needle."""

STATION_PX = 2.0
"""From station to station of a strip."""

LARGEST_TURN_RAD = math.radians(46)
"""Between a needle and the way from its trocar to the globe's centre."""

OUTSIDE_MM = 12.0  # how far beyond the trocar the shaft is looked at
HALF_WIDTH_MM = 0.5  # of the thickest needle
MARGIN_PX = 6
RIM_PX = 1.5
FAR_PX = 1.0  # beyond the far wall's edge a tip that touches it may still be seen
WALL_MARGIN_MM = 0.1
BEYOND_MM = 0.5  # past the far wall: a tip may be pushed into the retina

_pack = struct.Struct("PniiPniiPPdiii").pack
_place_strip = function("place_strip", "ipiffffffpp")
_level_strip = function("level_strip", "piiipdddfppp", ctypes.c_double)


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
        dx, dy = self.direction
        return -dy, dx

    def at_px(self, trocar_px: Vec, along_px: float) -> Vec:
        """Return the place so far along the line from the trocar's foot."""
        (x, y), (dx, dy) = trocar_px, self.direction
        return x - self.offset_px * dy + along_px * dx, y + self.offset_px * dx + along_px * dy


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

    @property
    def box(self) -> tuple[slice, slice]:
        """Rows and columns of the image where strips can lie: the globe, and the cone before the trocar."""
        reach = self.inner_px + BEYOND_MM * self.px_per_mm
        places = [(self.center_px[0] + side * reach, self.center_px[1] + side * reach) for side in (-1, 1)]
        for turn_rad in (-LARGEST_TURN_RAD, 0.0, LARGEST_TURN_RAD):
            line = Line(self.inwards_rad + turn_rad, 0.0)
            places.append(line.at_px(self.trocar_px, -OUTSIDE_MM * self.px_per_mm))
        x, y = zip(*places, strict=True)
        return _span(y, self.half_px, self.height_px), _span(x, self.half_px, self.width_px)

    def is_inside(self) -> Mask:
        """Return which pixels lie within the globe's outer wall, (height_px, width_px)."""
        y, x = np.ogrid[: self.height_px, : self.width_px]
        (center_x, center_y), radius = self.center_px, self.outer_px
        return np.asarray((x - center_x) ** 2 + (y - center_y) ** 2 < radius**2, np.bool_)

    def wall_px(self, line: Line) -> tuple[float, float, float] | None:
        """Return where a line enters and leaves the wall and meets the far side; None if it misses."""
        (dx, dy), foot = line.direction, line.at_px(self.trocar_px, 0.0)
        x, y = self.center_px[0] - foot[0], self.center_px[1] - foot[1]
        along, aside = x * dx + y * dy, x * dy - y * dx
        if abs(aside) >= self.inner_px:
            return None
        outer = math.sqrt(self.outer_px**2 - aside**2)
        inner = math.sqrt(self.inner_px**2 - aside**2)
        return along - outer, along - inner, along + inner

    def first_px(self, line: Line) -> float:
        """Return where, seen from the trocar outwards, a line leaves the image or what is looked at."""
        start = -OUTSIDE_MM * self.px_per_mm
        foot = line.at_px(self.trocar_px, 0.0)
        for place, step, size in zip(foot, line.direction, (self.width_px, self.height_px), strict=True):
            if abs(step) > 1e-9:
                start = max(start, -place / step if step > 0 else (size - 1 - place) / step)
        return start


def _span(places_px: Sequence[float], margin_px: int, size_px: int) -> slice:
    """Return where an image holds places and some margin about them."""
    first, last = math.floor(min(places_px)) - margin_px, math.ceil(max(places_px)) + margin_px + 1
    return slice(max(first, 0), min(last, size_px))


class RectifiedStrip(Struct, frozen=True, eq=False):
    """Straightened pixels along an expected line."""

    u_px: FloatImage
    """Where each station lies along the line, evenly spaced, (n,)."""
    half_px: int
    """Lanes reach so far to either side."""
    excess: FloatImage
    """What differs from the empty eye and from the flanks, grey levels, (2 half_px + 1, n)."""
    beside: FloatImage
    """What differs from the flanks alone, same shape."""
    is_known: Mask
    """Stations where the empty eye is known, (n,)."""
    before: slice
    """Stations before the wall."""
    inside: slice
    """Stations within the globe; those in the wall are in neither."""
    noise_grey: float
    """Standard deviation of a pixel of `excess` without needle."""
    native: bytes = b""
    """The same as C has it; always made from the rest."""

    def __post_init__(self) -> None:
        (lanes, stations), ends = self.excess.shape, (self.before.stop, self.inside.start, self.inside.stop)
        along = self.u_px, self.is_known
        if self.beside.shape != self.excess.shape or any(len(values) != stations for values in along):
            raise ValueError(f"not everything has the {stations} stations of the excess")
        if self.u_px.dtype != np.float32 or self.is_known.dtype != np.bool_ or max(ends) > stations:
            raise ValueError("places are float32, what is known is bool, and parts end within the strip")
        native = _pack(
            *(*rows(self.excess), lanes, stations, *rows(self.beside), lanes, stations),
            *(address(self.u_px), address(self.is_known), self.noise_grey, *ends),
        )
        force_setattr(self, "native", native)


def stations(
    site: Site, line: Line, from_px: float = -math.inf, until_px: float = math.inf
) -> FloatImage | None:
    """Return the places along a line where a shaft could be seen, (n,).

    Args:
        site: Where things are.
        line: The line.
        from_px: Where along the line to start at the earliest.
        until_px: Where along the line to stop at the latest.

    Returns:
        The places, or None if the line misses the globe.
    """
    wall = site.wall_px(line)
    if wall is None:
        return None
    outer, inner, far = wall
    scale = site.px_per_mm
    last = max(min(far + BEYOND_MM * scale, until_px), inner + 2 * scale)
    first = math.ceil(max(min(site.first_px(line) + 1, outer), min(from_px, last - 2 * scale)))
    return np.arange(first, last, STATION_PX, dtype=np.float32)


def rectify(
    site: Site,
    image: Image,
    empty: FloatImage,
    line: Line,
    *runs_px: FloatImage,
    chroma_share: float = 0.0,
    light: float = 1.0,
) -> list[RectifiedStrip] | None:
    """Lay the surroundings of one or more parts of a line straight, all at once.

    Args:
        site: Where things are.
        image: (h, w, 3) BGR or (h, w) grey.
        empty: The eye without needle, (h, w) grey; negative where not known.
        line: The line.
        runs_px: Evenly spaced places along it, (n,) each, two at least.
        chroma_share: Of blue less red in the grey within the globe, which `empty` has in it as well.
        light: How many times brighter the strips are than the image.

    Returns:
        A strip of each run, or None if the line misses the globe.
    """
    wall = site.wall_px(line)
    if wall is None:
        return None
    u_px = runs_px[0] if len(runs_px) == 1 else np.concatenate(runs_px)
    places = _places(site, line, u_px)
    seen, excess = (_sampled(picture, places) for picture in (image, empty))
    beside, is_known = np.empty(excess.shape, np.float32), np.empty(len(u_px), np.bool_)
    outer, inner, far = wall
    noise_grey = _level_strip(
        *(address(seen), seen.size // beside.size, *beside.shape, address(u_px)),
        *(chroma_share, outer, far + inner - outer, light),
        *(address(excess), address(beside), address(is_known)),
    )
    strips, start = [], 0
    for run_px in runs_px:
        part = slice(start, start + len(run_px))
        before, inside = _sides(run_px, wall)
        strips.append(
            RectifiedStrip(
                *(run_px, site.half_px, excess[:, part], beside[:, part]),
                *(is_known[part], before, inside, noise_grey),
            )
        )
        start = part.stop
    return strips


def _places(site: Site, line: Line, u_px: FloatImage) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
    """Return where the pixels of a strip lie in the image, as OpenCV has it: whole pixels, and the rest."""
    shape = 2 * site.half_px + 1, len(u_px)
    whole, rest = np.empty((*shape, 2), np.int16), np.empty(shape, np.uint16)
    _place_strip(
        *(site.half_px, address(u_px), len(u_px), *line.at_px(site.trocar_px, 0.0)),
        *(*line.normal, *line.direction, address(whole), address(rest)),
    )
    return whole, rest


def _sampled(image: NDArray[Any], places: tuple[NDArray[np.int16], NDArray[np.uint16]]) -> NDArray[Any]:
    return cv2.remap(image, *places, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)


def _sides(u_px: FloatImage, wall_px: tuple[float, float, float]) -> tuple[slice, slice]:
    """Return the stations before the wall, and those within the globe."""
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
