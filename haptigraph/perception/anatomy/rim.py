"""Find the rim of the opened globe in a still image: the inner and the outer edge of its wall [px].

Image in, two nearly round curves out. Edges may have contrast of either sign, and of another sign elsewhere.
Knows nothing of retina, needle or millimetres.
"""

import math

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.errors import BadInput
from haptigraph.geometry import Vec
from haptigraph.imaging import Floats, colored
from haptigraph.messages import Image
from haptigraph.perception.anatomy.edge import FAINTEST_GREY, SMOOTHING_PX, Edge, edge_near, rays_from

__all__ = ["Rim", "find_rim"]

SMALLEST_RADIUS_PX = 60.0
VOTING_WIDTH_PX = 400.0
WALL_RATIO = (1.04, 1.45)  # outer over inner radius
TYPICAL_MIDDLE = 1.07  # of a wall whose outer edge is not seen
MOST_GAIN = 8.0
DARKEST_GREY = 12.0  # of a picture's brightest part
MOST_BLUR = 0.03  # of the radius


class Rim(Struct, frozen=True, eq=False):
    """The cut wall of the globe."""

    inner: Edge
    outer: Edge | None
    """None: no outer edge was seen."""

    @property
    def middle_px(self) -> float:
        """Radius of the middle of the wall, about the inner edge's centre."""
        if self.outer is None:
            return self.inner.radius_px * TYPICAL_MIDDLE
        return (self.inner.radius_px + self.outer.radius_px) / 2


def find_rim(image: Image) -> Rim:
    """Find the globe's wall.

    Args:
        image: (h, w, 3) or (h, w), without needle at best.

    Raises:
        BadInput: If there is no eye, or it is cut off or blurred; it says which.
    """
    color = colored(image)
    bright = _brightened(color)
    _check_sharpness(bright)
    picture = np.asarray(cv2.GaussianBlur(bright, (0, 0), SMOOTHING_PX), np.float32)
    candidates = [edge_near(picture, center, radius) for center, radius in _voted(picture)]
    seen = [edge for edge in candidates if edge is not None]
    if not seen:
        raise BadInput("no eye in the picture: nothing round and at least 60 px in radius stands out")
    rims = [rim for edge in seen[:2] if (rim := _completed(picture, edge)) is not None]
    rim = max(rims, key=_certainty, default=None) or Rim(seen[0], None)
    _check(rim.inner, picture.shape[1], picture.shape[0])
    return rim


def _certainty(rim: Rim) -> float:
    return rim.inner.support_ratio + (rim.outer.support_ratio if rim.outer else 0.0)


def _brightened(color: Image) -> NDArray[np.float32]:
    """Return the picture as if it had been exposed fully."""
    brightest = float(np.quantile(color[::4, ::4], 0.995))
    if brightest < DARKEST_GREY:
        raise BadInput(
            f"no eye in the picture: it is dark, its brightest parts have {brightest:.0f} of 255 grey levels"
        )
    brightest = max(brightest, 255 / MOST_GAIN)
    return color.astype(np.float32) * np.float32(255 / brightest)


def _check_sharpness(color: NDArray[np.float32]) -> None:
    """Refuse a picture without any sharp edge.

    The steepest slopes of a picture with blur b fall with smoothing s as 1 / sqrt(b^2 + s^2).
    """
    grey = cv2.cvtColor(color, cv2.COLOR_BGR2GRAY)
    fine, coarse = (float(np.quantile(_slope(cv2.GaussianBlur(grey, (0, 0), s)), 0.998)) for s in (1.5, 6.0))
    if fine < FAINTEST_GREY:
        raise BadInput("no eye in the picture: it shows no edges at all")
    if fine < 1.25 * coarse:
        raise BadInput("the picture is blurred: no edge in it is sharp enough to measure; focus the camera")


def _slope(grey: "NDArray[np.float32] | cv2.typing.MatLike") -> Floats:
    dy, dx = np.gradient(np.asarray(grey, np.float64))
    return np.asarray(np.hypot(dx, dy))


def _voted(picture: NDArray[np.float32]) -> list[tuple[Vec, float]]:
    """Return the likeliest circles (centre, radius): every edge votes along its normal, both ways."""
    scale = min(1.0, VOTING_WIDTH_PX / picture.shape[1])
    small = cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    height, width = small.shape[:2]
    x, y, normal_x, normal_y = _edges(np.asarray(small, np.float32))
    pad = max(height, width) // 4
    shape = height + 2 * pad, width + 2 * pad
    radii = np.arange(max(6.0, SMALLEST_RADIUS_PX * scale * 0.9), 0.6 * max(height, width), 1.5)
    found = []
    for radius in radii:
        votes = np.zeros(shape[0] * shape[1])
        for side in (-1.0, 1.0):
            at_x = np.rint(x + side * radius * normal_x).astype(int) + pad
            at_y = np.rint(y + side * radius * normal_y).astype(int) + pad
            inside = (at_x >= 0) & (at_x < shape[1]) & (at_y >= 0) & (at_y < shape[0])
            votes += np.bincount(at_y[inside] * shape[1] + at_x[inside], minlength=votes.size)
        blurred = cv2.blur(votes.reshape(shape), (5, 5)) * 25 / (2 * math.pi * radius)
        _, most, _, (best_x, best_y) = cv2.minMaxLoc(blurred)
        found.append(
            (most, (best_x - pad + 0.5) / scale - 0.5, (best_y - pad + 0.5) / scale - 0.5, radius / scale)
        )
    return _apart(sorted(found, reverse=True))


def _apart(found: list[tuple[float, float, float, float]]) -> list[tuple[Vec, float]]:
    """Keep the best circles that are not nearly the same."""
    kept: list[tuple[Vec, float]] = []
    for _, x, y, radius in found:
        near = any(math.hypot(x - c[0], y - c[1]) < 0.04 * r and abs(radius - r) < 0.04 * r for c, r in kept)
        if not near:
            kept.append(((x, y), radius))
    return kept[:4]


def _edges(small: NDArray[np.float32]) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the places (x, y) of edges and their unit normals, by the colour that changes most."""
    dx, dy = (cv2.Sobel(small, cv2.CV_32F, *order, ksize=3) / 8 for order in ((1, 0), (0, 1)))
    strongest = np.hypot(dx, dy).argmax(axis=2)[..., None]
    dx, dy = (np.take_along_axis(d, strongest, 2)[..., 0].astype(np.float64) for d in (dx, dy))
    size = np.hypot(dx, dy)
    y, x = np.nonzero(size > max(FAINTEST_GREY, float(np.quantile(size, 0.8))))
    return x.astype(float), y.astype(float), dx[y, x] / size[y, x], dy[y, x] / size[y, x]


def _completed(picture: NDArray[np.float32], edge: Edge) -> Rim | None:
    """Find the wall's other edge beside one of them, further in or further out."""
    pairs = []
    rays = rays_from(
        picture, edge.center_px, edge.radius_px / WALL_RATIO[1] - 4, edge.radius_px * WALL_RATIO[1] + 4
    )
    # What every ray sees at about the same radius; median, so that what few rays see counts for nothing.
    seen = np.asarray(np.isfinite(rays.strength).any(axis=0))
    profile = np.zeros(len(seen))
    profile[seen] = np.nanmedian(rays.strength[:, seen], axis=0)
    profile = np.asarray(cv2.GaussianBlur(profile[None, :], (0, 0), 2.0))[0]
    around = np.asarray(cv2.blur(profile[None, :], (61, 1)))[0]
    is_top = (
        (profile[1:-1] > profile[:-2]) & (profile[1:-1] >= profile[2:]) & (profile[1:-1] > 1.2 * around[1:-1])
    )
    for radius_px in rays.radii_px[1:-1][is_top]:
        small, large = sorted((float(radius_px), edge.radius_px))
        if not WALL_RATIO[0] <= large / small <= WALL_RATIO[1] or small < SMALLEST_RADIUS_PX:
            continue
        other = edge_near(picture, edge.center_px, float(radius_px), 0.02)
        if other is None:
            continue
        inner, outer = (other, edge) if other.radius_px < edge.radius_px else (edge, other)
        apart_px = math.dist(inner.center_px, outer.center_px)
        if WALL_RATIO[0] <= outer.radius_px / inner.radius_px and apart_px < 0.03 * inner.radius_px:
            pairs.append(Rim(inner, outer))
    return max(pairs, key=_certainty, default=None)


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
            f"the eye is cut off: its wall's inner edge reaches {beyond[side]:.0f} px over the {side} "
            "border; the whole globe must be in the picture"
        )
    if inner.radius_px < SMALLEST_RADIUS_PX:
        raise BadInput(f"the eye is too small: {inner.radius_px:.0f} px in radius, at least 60 px are needed")
    if inner.blur_px > max(MOST_BLUR * inner.radius_px, 2.5):
        raise BadInput(
            f"the picture is blurred: the globe's edge is {inner.blur_px:.1f} px soft, at most "
            f"{max(MOST_BLUR * inner.radius_px, 2.5):.1f} px can be measured; focus the camera"
        )
