"""Find the rim of the opened globe in a still image: the inner and the outer edge of its wall [px].

Image in, two nearly round curves out. Edges may have contrast of either sign, and of another sign elsewhere.
Knows nothing of retina, needle or millimetres.
"""

import math
from typing import TypeAlias

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.errors import BadInput
from haptigraph.geometry import Vec
from haptigraph.messages import Image

__all__ = ["Edge", "Rim", "find_rim"]

Floats: TypeAlias = NDArray[np.float64]

SMALLEST_RADIUS_PX = 60.0
VOTING_WIDTH_PX = 400.0
SMOOTHING_PX = 1.0
RAYS = 720
STEP_PX = 0.5
WALL_RATIO = (1.04, 1.45)  # outer over inner radius
TYPICAL_MIDDLE = 1.07  # of a wall whose outer edge is not seen
FAINTEST_GREY = 1.0  # of an edge, per px
CLEAR = 2.5  # an edge's strength over what lies around it
LEAST_SUPPORT = 0.5  # share of the rays that must see the edge
INLIER_PX = 1.5
MOST_BLUR = 0.03  # of the radius
TRIALS = 400


class Edge(Struct, frozen=True, eq=False):
    """A nearly round edge around a centre: radius = even part + places where it was seen.

    Angles are at the centre, 0 downwards, towards the image's right [rad].
    """

    center_px: Vec
    harmonics_px: Floats
    """(5,): factors of 1, cos, sin, cos 2, sin 2 of the angle."""
    angles: Floats
    """(n,): where the edge was seen."""
    offsets_px: Floats
    """(n,): how far outside the even curve it was seen there."""
    support: float
    """Share of the rays in the image that saw it."""
    blur_px: float
    """Deviation of the edge's spread."""

    @property
    def radius_px(self) -> float:
        """Mean radius."""
        return float(self.harmonics_px[0])

    @property
    def out_of_round_px(self) -> float:
        """Half the difference of the longest and the shortest radius, as an ellipse has them."""
        return float(math.hypot(*self.harmonics_px[3:]))

    @property
    def residual_px(self) -> float:
        """RMS of the places where it was seen."""
        return float(np.sqrt(np.mean(self.offsets_px**2)))

    def radii_px(self, angles: Floats) -> Floats:
        """Return the radius of the even curve at angles, (n,)."""
        return np.asarray(_basis(angles) @ self.harmonics_px)


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


class _Rays(Struct, eq=False):
    """Edge strength along rays from a centre."""

    center_px: Vec
    angles: Floats
    radii_px: Floats
    strength: Floats
    """(rays, radii), grey levels per px; nan outside the image."""


def find_rim(image: Image) -> Rim:
    """Find the globe's wall.

    Args:
        image: (h, w, 3) or (h, w), without needle at best.

    Raises:
        BadInput: If there is no eye, or it is cut off or blurred; it says which.
    """
    color = image if image.ndim == 3 else cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    picture = np.asarray(cv2.GaussianBlur(color, (0, 0), SMOOTHING_PX), np.uint8).astype(np.float32)
    _check_sharpness(color)
    candidates = [_edge_near(picture, center, radius) for center, radius in _voted(picture)]
    seen = [edge for edge in candidates if edge is not None]
    if not seen:
        raise BadInput("no eye in the picture: nothing round and at least 60 px in radius stands out")
    rims = [rim for edge in seen[:3] if (rim := _completed(picture, edge)) is not None]
    rim = max(rims, key=_certainty, default=None) or Rim(seen[0], None)
    _check(rim.inner, picture.shape[1], picture.shape[0])
    return rim


def _certainty(rim: Rim) -> float:
    return rim.inner.support + (rim.outer.support if rim.outer else 0.0)


def _check_sharpness(color: Image) -> None:
    """Refuse a picture without any sharp edge.

    The steepest slopes of a picture with blur b fall with smoothing s as 1 / sqrt(b^2 + s^2).
    """
    grey = cv2.cvtColor(color, cv2.COLOR_BGR2GRAY).astype(np.float32)
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
    radii = np.arange(max(6.0, SMALLEST_RADIUS_PX * scale * 0.9), 0.6 * max(height, width))
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
    return kept[:6]


def _edges(small: NDArray[np.float32]) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the places (x, y) of edges and their unit normals, by the colour that changes most."""
    dx, dy = (cv2.Sobel(small, cv2.CV_32F, *order, ksize=3) / 8 for order in ((1, 0), (0, 1)))
    strongest = np.hypot(dx, dy).argmax(axis=2)[..., None]
    dx, dy = (np.take_along_axis(d, strongest, 2)[..., 0].astype(np.float64) for d in (dx, dy))
    size = np.hypot(dx, dy)
    y, x = np.nonzero(size > max(FAINTEST_GREY, float(np.quantile(size, 0.8))))
    return x.astype(float), y.astype(float), dx[y, x] / size[y, x], dy[y, x] / size[y, x]


def _rays(picture: NDArray[np.float32], center: Vec, low_px: float, high_px: float) -> _Rays:
    angles = np.arange(RAYS) * 2 * math.pi / RAYS
    radii = np.arange(low_px, high_px, STEP_PX)
    x = (center[0] + np.outer(np.sin(angles), radii)).astype(np.float32)
    y = (center[1] + np.outer(np.cos(angles), radii)).astype(np.float32)
    unrolled = np.asarray(cv2.remap(picture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
    change = np.gradient(unrolled.astype(np.float64), STEP_PX, axis=1)
    strength = np.sqrt(np.mean(change**2, axis=2))
    height, width = picture.shape[:2]
    strength[(x < 2) | (x > width - 3) | (y < 2) | (y > height - 3)] = np.nan
    return _Rays(center, angles, radii, strength)


def _edge_near(
    picture: NDArray[np.float32], center: Vec, radius_px: float, reach: float = 0.04
) -> Edge | None:
    """Fit the edge that lies within a share of the radius of a circle; None if there is hardly any."""
    harmonics = np.array([radius_px, 0.0, 0.0, 0.0, 0.0])
    edge = None
    for reach_px in (max(reach * radius_px, 4.0), 4.0, 4.0):
        margin_px = reach_px + 3 * math.hypot(*harmonics[3:]) + 8
        rays = _rays(picture, center, max(harmonics[0] - margin_px, 2), harmonics[0] + margin_px)
        edge = _fitted(rays, harmonics, reach_px)
        if edge is None:
            return None
        right, down = edge.harmonics_px[2], edge.harmonics_px[1]
        center = center[0] + right, center[1] + down
        harmonics = edge.harmonics_px * np.array([1, 0, 0, 1, 1])
    return edge


def _fitted(rays: _Rays, harmonics: Floats, reach_px: float) -> Edge | None:
    expected = _basis(rays.angles) @ harmonics
    near = np.abs(rays.radii_px[None, :] - expected[:, None]) <= reach_px
    in_image = np.all(np.isfinite(rays.strength) | ~near, axis=1)
    if in_image.mean() < 0.3:
        return None
    strength = np.where(near & in_image[:, None], np.nan_to_num(rays.strength), 0.0)
    peaks_px, is_clear = _peaks(rays, strength)
    is_clear &= in_image
    if is_clear.sum() < LEAST_SUPPORT / 2 * in_image.sum():
        return None
    angles, radii = rays.angles[is_clear], peaks_px[is_clear]
    fitted = _robust(angles, radii)
    offsets = radii - _basis(angles) @ fitted
    close = np.abs(offsets) < INLIER_PX
    support = float(close.sum() / in_image.sum())
    if support < LEAST_SUPPORT:
        return None
    blur_px = _spread(rays, fitted, angles[close])
    return Edge(rays.center_px, fitted, angles[close], offsets[close], support, blur_px)


def _peaks(rays: _Rays, strength: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return where each ray is strongest [px], between samples, and whether that is an edge."""
    row = np.arange(len(strength))
    best = np.clip(strength.argmax(axis=1), 1, strength.shape[1] - 2)
    before, at, after = (strength[row, best + d] for d in (-1, 0, 1))
    bend = before - 2 * at + after
    shift = np.where(bend < 0, 0.5 * (before - after) / np.where(bend < 0, bend, 1), 0)
    is_peak = (at >= before) & (at >= after) & (before > 0) & (after > 0) & (at > FAINTEST_GREY)
    return rays.radii_px[best] + np.clip(shift, -0.5, 0.5) * STEP_PX, is_peak


def _robust(angles: Floats, radii_px: Floats) -> Floats:
    """Fit the curve that most places agree with, then by least squares to those."""
    basis = _basis(angles)
    rng = np.random.default_rng(0)
    picks = rng.integers(0, len(angles), (TRIALS, 5))
    square = basis[picks]
    solvable = np.abs(np.linalg.det(square)) > 0.05
    tried = np.linalg.solve(square[solvable], radii_px[picks][solvable][..., None])[..., 0]
    tried = np.vstack([tried, [np.median(radii_px), 0, 0, 0, 0]])
    agree = (np.abs(tried @ basis.T - radii_px) < INLIER_PX).sum(axis=1)
    fitted = tried[agree.argmax()]
    for _ in range(5):
        close = np.abs(basis @ fitted - radii_px) < INLIER_PX
        if close.sum() < 10:
            break
        fitted = np.linalg.lstsq(basis[close], radii_px[close], rcond=None)[0]
    return np.asarray(fitted)


def _spread(rays: _Rays, fitted: Floats, angles: Floats) -> float:
    """Return the edge's deviation from its half width, beyond what the smoothing made [px]."""
    rows = np.rint(angles / (2 * math.pi) * RAYS).astype(int)
    away = np.arange(-8.0, 8.01, STEP_PX)
    expected = _basis(angles) @ fitted
    at = np.clip(
        np.rint((expected[:, None] + away - rays.radii_px[0]) / STEP_PX).astype(int),
        0,
        len(rays.radii_px) - 1,
    )
    profile = np.nanmedian(rays.strength[rows[:, None], at], axis=0)
    width_px = float((profile > profile.max() / 2).sum()) * STEP_PX
    return math.sqrt(max((width_px / 2.355) ** 2 - SMOOTHING_PX**2, 0.0))


def _completed(picture: NDArray[np.float32], edge: Edge) -> Rim | None:
    """Find the wall's other edge beside one of them, further in or further out."""
    pairs = []
    rays = _rays(
        picture, edge.center_px, edge.radius_px / WALL_RATIO[1] - 4, edge.radius_px * WALL_RATIO[1] + 4
    )
    # What every ray sees at about the same radius; median, so that what few rays see counts for nothing.
    profile = np.nan_to_num(np.nanmedian(rays.strength, axis=0)) if np.isfinite(rays.strength).any() else None
    if profile is None:
        return None
    profile = np.asarray(cv2.GaussianBlur(profile[None, :], (0, 0), 2.0))[0]
    around = np.asarray(cv2.blur(profile[None, :], (61, 1)))[0]
    is_top = (
        (profile[1:-1] > profile[:-2]) & (profile[1:-1] >= profile[2:]) & (profile[1:-1] > 1.2 * around[1:-1])
    )
    for radius_px in rays.radii_px[1:-1][is_top]:
        small, large = sorted((float(radius_px), edge.radius_px))
        if not WALL_RATIO[0] <= large / small <= WALL_RATIO[1] or small < SMALLEST_RADIUS_PX:
            continue
        other = _edge_near(picture, edge.center_px, float(radius_px), 0.02)
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
            f"the eye is cut off: its wall's inner edge reaches {beyond[side]:.0f} px over the {side} border; "
            "the whole globe must be in the picture"
        )
    if inner.radius_px < SMALLEST_RADIUS_PX:
        raise BadInput(f"the eye is too small: {inner.radius_px:.0f} px in radius, at least 60 px are needed")
    if inner.blur_px > max(MOST_BLUR * inner.radius_px, 2.5):
        raise BadInput(
            f"the picture is blurred: the globe's edge is {inner.blur_px:.1f} px soft, at most "
            f"{max(MOST_BLUR * inner.radius_px, 2.5):.1f} px can be measured; focus the camera"
        )


def _basis(angles: Floats) -> Floats:
    return np.stack(
        [np.ones_like(angles), np.cos(angles), np.sin(angles), np.cos(2 * angles), np.sin(2 * angles)],
        axis=-1,
    )
