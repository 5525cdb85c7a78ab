"""Find the rim of the opened globe: the inner and the outer edge of its wall, nearly circular curves [px].

The sign of an edge's contrast may vary along it.
"""

import math
from collections.abc import Iterator

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.errors import BadInput
from haptigraph.geometry import Vec
from haptigraph.imaging import Floats, colored, grey_of
from haptigraph.messages import Image
from haptigraph.perception.anatomy.edge import MIN_EDGE_GREY, SMOOTHING_PX, Edge, edge_near, rays_from
from haptigraph.perception.anatomy.expected import Expected
from haptigraph.registration.camera import MIN_RADIUS_PX

__all__ = ["MIN_SHARPNESS", "TYPICAL_WALL_MIDDLE", "Rim", "find_rim", "sharpness", "visible_rim"]

VOTING_WIDTH_PX = 400.0
WALL_RATIO = (1.04, 1.45)  # outer over inner radius
TYPICAL_WALL_MIDDLE = 1.07
"""Radius of the middle of the wall over that of its inner edge, where the outer edge is not detected."""
OTHER_REACH = 0.02  # relative to the radius: so near its expected shape is the other edge of a wall
CONCENTRIC_RATIO = 0.1  # circles have one centre if theirs are closer, relative to the radius
MAX_GAIN = 8.0
MIN_BRIGHTEST_GREY = 12.0  # of an image's brightest part
MAX_BLUR_RATIO = 0.03  # of the radius
MIN_SHARPNESS = 1.25
"""Of an image with at least one sharp edge, as `sharpness` measures it."""


class Rim(Struct, frozen=True, eq=False):
    """The cut wall of the globe."""

    inner: Edge
    outer: Edge | None
    """None if it was not detected."""

    @property
    def middle_px(self) -> float:
        """Radius of the middle of the wall, about the inner edge's centre."""
        if self.outer is None:
            return self.inner.radius_px * TYPICAL_WALL_MIDDLE
        return (self.inner.radius_px + self.outer.radius_px) / 2


def find_rim(image: Image, expected: Expected | None = None) -> Rim:
    """Find the globe's wall, first where it is expected; refuse what cannot be registered.

    Args:
        image: (h, w, 3) or (h, w), best without needle.
        expected: The anatomy as designed, if known.

    Raises:
        BadInput: If there is no eye, or it is cut off or blurred.
    """
    rim = visible_rim(image, expected)
    _check(rim.inner, image.shape[1], image.shape[0])
    return rim


def visible_rim(image: Image, expected: Expected | None = None) -> Rim:
    """Find what is visible of the globe's wall, which may be cut off, small or blurred.

    Args:
        image: (h, w, 3) or (h, w), best without needle.
        expected: The anatomy as designed, if known; it is first searched there.

    Raises:
        BadInput: If there is no eye, or nothing is sharp.
    """
    bright = _normalized(colored(image))
    _check_sharpness(bright)
    smooth = np.asarray(cv2.GaussianBlur(bright, (0, 0), SMOOTHING_PX), np.float32)
    rim = _expected_rim(smooth, expected) if expected else None
    return rim or _any_rim(smooth)


def _any_rim(smooth: NDArray[np.float32]) -> Rim:
    """Return the most complete rim at the circles voted for; raise BadInput if there is no edge."""
    candidates = [edge_near(smooth, center, radius) for center, radius in _vote_circles(smooth)]
    edges = [edge for edge in candidates if edge is not None]
    if not edges:
        raise BadInput(f"no eye in the picture: found no circle of at least {MIN_RADIUS_PX:.0f} px in radius")
    for some in edges[:2], edges[2:]:
        if rims := [rim for edge in some if (rim := _complete(smooth, edge)) is not None]:
            return max(rims, key=_support)
    return Rim(edges[0], None)


def _expected_rim(smooth: NDArray[np.float32], expected: Expected) -> Rim | None:
    """Return the most complete rim where it is expected; None if there is none.

    With both edges at the expected ratio it may have another size; one edge alone could be either.
    """
    circles = _vote_circles(smooth, expected.radii_px())
    near = [(center, radius) for center, radius in circles if expected.is_near(center, radius)]
    radius_px = expected.radius_px * expected.rim_ratio
    centers = [center for center, _ in circles if expected.is_near(center, radius_px)]
    starts = [*near, *((center, radius_px) for center in [*centers, expected.center_px])]
    edges = [edge for start in starts if (edge := edge_near(smooth, *start)) is not None]
    rims = [Rim(edge, None) for edge in edges if expected.is_near(edge.center_px, edge.radius_px)]
    rims += [rim for edge in edges for rim in _expected_walls(smooth, edge, expected)]
    return max(rims, key=_support, default=None)


def _expected_walls(smooth: NDArray[np.float32], edge: Edge, expected: Expected) -> Iterator[Rim]:
    """Yield walls of the expected thickness that have an edge inside or outside, round as a rig's are."""
    for ratio in (expected.wall_ratio, 1 / expected.wall_ratio):
        other = edge_near(smooth, edge.center_px, edge.radius_px * ratio, OTHER_REACH)
        inner, outer = (edge, other) if ratio > 1 else (other, edge)
        if inner and outer and expected.is_wall(outer.radius_px / inner.radius_px):
            yield Rim(inner, outer)


def sharpness(image: Image) -> float:
    """Return how much the image's steepest edges flatten when it is smoothed; about 1 if it is blurred."""
    fine, coarse = _steepest(np.asarray(grey_of(image), np.float32))
    return fine / max(coarse, 1e-6)


def _support(rim: Rim) -> float:
    return rim.inner.support_ratio + (rim.outer.support_ratio if rim.outer else 0.0)


def _normalized(color: Image) -> NDArray[np.float32]:
    """Scale an image to full exposure."""
    brightest = float(np.quantile(color[::4, ::4], 0.995))
    if brightest < MIN_BRIGHTEST_GREY:
        raise BadInput(
            f"no eye in the picture: it is dark, its brightest parts have {brightest:.0f} of 255 grey "
            "levels; use more light or a longer exposure"
        )
    brightest = max(brightest, 255 / MAX_GAIN)
    return color.astype(np.float32) * np.float32(255 / brightest)


def _check_sharpness(color: NDArray[np.float32]) -> None:
    """Refuse an image without any sharp edge."""
    fine, coarse = _steepest(np.asarray(cv2.cvtColor(color, cv2.COLOR_BGR2GRAY), np.float32))
    if fine < MIN_EDGE_GREY:
        raise BadInput("no eye in the picture: it has no edges")
    if fine < MIN_SHARPNESS * coarse:
        raise BadInput("the image is blurred: none of its edges is sharp enough to measure; focus the camera")


def _steepest(grey: NDArray[np.float32]) -> tuple[float, float]:
    """Return the steepest gradients of an image, smoothed a little and much.

    Those of an image with blur b fall with smoothing s as 1 / sqrt(b^2 + s^2).
    """
    smoothed = (cv2.GaussianBlur(grey, (0, 0), sigma) for sigma in (1.5, 6.0))
    fine, coarse = (float(np.quantile(_gradient(each), 0.998)) for each in smoothed)
    return fine, coarse


def _gradient(grey: "NDArray[np.float32] | cv2.typing.MatLike") -> Floats:
    dy, dx = np.gradient(np.asarray(grey, np.float64))
    return np.asarray(np.hypot(dx, dy))


def _vote_circles(
    image: NDArray[np.float32], radii_px: tuple[float, float] = (MIN_RADIUS_PX * 0.9, math.inf)
) -> list[tuple[Vec, float]]:
    """Find circles (centre, radius) by Hough transform: edges vote along their normals, both ways."""
    scale = min(1.0, VOTING_WIDTH_PX / image.shape[1])
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    height, width = small.shape[:2]
    x, y, normal_x, normal_y = _edge_pixels(np.asarray(small, np.float32))
    pad = max(height, width) // 4
    rows, columns = height + 2 * pad, width + 2 * pad
    from_x, from_y = np.tile(x + pad, 2), np.tile(y + pad, 2)
    normal_x, normal_y = (np.concatenate([-each, each]) for each in (normal_x, normal_y))
    low, high = (radius_px * scale for radius_px in radii_px)
    radii = np.arange(max(6.0, low), min(high, 0.6 * max(height, width)), 1.5)
    found = []
    for radius in radii:
        at_x, at_y = np.rint(from_x + radius * normal_x), np.rint(from_y + radius * normal_y)
        inside = (at_x >= 0) & (at_x < columns) & (at_y >= 0) & (at_y < rows)
        pixels = (at_y * columns + at_x)[inside].astype(int)
        votes = np.bincount(pixels, minlength=rows * columns).astype(np.float32).reshape(rows, columns)
        _, most, _, (best_x, best_y) = cv2.minMaxLoc(cv2.boxFilter(votes, -1, (5, 5), normalize=False))
        at = (best_x - pad + 0.5) / scale - 0.5, (best_y - pad + 0.5) / scale - 0.5
        found.append((most / (2 * math.pi * radius), *at, radius / scale))
    return _distinct(sorted(found, reverse=True))


def _distinct(found: list[tuple[float, float, float, float]]) -> list[tuple[Vec, float]]:
    """Return the best circles without near duplicates, at most two about one centre: a wall has two edges.

    So a small part with many rings, such as a screw's head, leaves room for the eye.
    """
    kept: list[tuple[Vec, float]] = []
    for _, x, y, radius in found:
        apart = [(math.hypot(x - c[0], y - c[1]) / max(r, radius), abs(radius - r) / r) for c, r in kept]
        is_near = any(off < 0.04 and larger < 0.04 for off, larger in apart)
        if not is_near and sum(off < CONCENTRIC_RATIO for off, _ in apart) < 2:
            kept.append(((x, y), radius))
    return kept[:4]


def _edge_pixels(small: NDArray[np.float32]) -> tuple[Floats, Floats, Floats, Floats]:
    """Return coordinates (x, y) and unit normals of edge pixels, in the colour of highest contrast."""
    dx, dy = (cv2.Sobel(small, cv2.CV_32F, *order, ksize=3) / 8 for order in ((1, 0), (0, 1)))
    strongest = np.hypot(dx, dy).argmax(axis=2)[..., None]
    dx, dy = (np.take_along_axis(d, strongest, 2)[..., 0].astype(np.float64) for d in (dx, dy))
    gradient = np.hypot(dx, dy)
    y, x = np.nonzero(gradient > max(MIN_EDGE_GREY, float(np.quantile(gradient, 0.8))))
    return x.astype(float), y.astype(float), dx[y, x] / gradient[y, x], dy[y, x] / gradient[y, x]


def _complete(image: NDArray[np.float32], edge: Edge) -> Rim | None:
    """Find the other edge of the wall, inside or outside a given one and as out of round."""
    pairs = []
    low_px, high_px = edge.radius_px / WALL_RATIO[1] - 4, edge.radius_px * WALL_RATIO[1] + 4
    rays = rays_from(image, edge.center_px, low_px, high_px, edge)
    # The median over rays suppresses what only few of them cross.
    is_observed = np.asarray(np.isfinite(rays.strength).any(axis=0))
    profile = np.zeros(len(is_observed))
    profile[is_observed] = np.nanmedian(rays.strength[:, is_observed], axis=0)
    profile = np.asarray(cv2.GaussianBlur(profile[None, :], (0, 0), 2.0))[0]
    background = np.asarray(cv2.blur(profile[None, :], (61, 1)))[0]
    inner_profile = profile[1:-1]
    is_peak = (inner_profile > profile[:-2]) & (inner_profile >= profile[2:])
    is_peak &= inner_profile > 1.2 * background[1:-1]
    for radius_px in rays.radii_px[1:-1][is_peak]:
        small, large = sorted((float(radius_px), edge.radius_px))
        if not WALL_RATIO[0] <= large / small <= WALL_RATIO[1] or small < MIN_RADIUS_PX:
            continue
        other = edge_near(image, edge.center_px, float(radius_px), OTHER_REACH, edge)
        if other is None:
            continue
        inner, outer = (other, edge) if other.radius_px < edge.radius_px else (edge, other)
        offset_px = math.dist(inner.center_px, outer.center_px)
        if WALL_RATIO[0] <= outer.radius_px / inner.radius_px and offset_px < 0.03 * inner.radius_px:
            pairs.append(Rim(inner, outer))
    return max(pairs, key=_support, default=None)


def _check(inner: Edge, width_px: int, height_px: int) -> None:
    (x, y), radius = inner.center_px, inner.radius_px + inner.out_of_round_px
    beyond = {
        "left": radius - x,
        "right": x + radius - width_px + 1,
        "top": radius - y,
        "bottom": y + radius - height_px + 1,
    }
    side = max(beyond, key=lambda name: beyond[name])
    if beyond[side] > 0:
        raise BadInput(
            f"the eye is cut off: its wall's inner edge extends {beyond[side]:.0f} px beyond the {side} "
            "border; the image must show the whole globe"
        )
    if inner.radius_px < MIN_RADIUS_PX:
        raise BadInput(
            f"the eye is too small: its radius is {inner.radius_px:.0f} px; "
            f"at least {MIN_RADIUS_PX:.0f} px are needed"
        )
    max_blur_px = max(MAX_BLUR_RATIO * inner.radius_px, 2.5)
    if inner.blur_px > max_blur_px:
        raise BadInput(
            f"the image is blurred: the globe's edge has a blur of {inner.blur_px:.1f} px, at most "
            f"{max_blur_px:.1f} px can be measured; focus the camera"
        )
