"""Fit a nearly circular edge: sample rays from its centre, find sub-pixel gradient maxima, fit a curve.

Turns an image and a rough circle into a curve and edge points. The contrast may change sign along the edge.
"""

import math

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats, peak_offset

__all__ = ["MIN_EDGE_GREY", "SMOOTHING_PX", "Edge", "Rays", "edge_near", "rays_from"]

SMOOTHING_PX = 1.0  # standard deviation with which callers smooth images
RAYS = 720
STEP_PX = 0.5
MIN_EDGE_GREY = 1.0  # grey levels per px
MIN_SUPPORT = 0.5  # share of the rays that must detect the edge
INLIER_PX = 1.5
TRIALS = 400


class Edge(Struct, frozen=True, eq=False):
    """A nearly circular edge around a centre: a smooth curve, and the measured offsets from it.

    Angles are about the centre, 0 downwards, positive towards the image's right [rad].
    """

    center_px: Vec
    harmonics_px: Floats
    """(5,): coefficients of 1, cos, sin, cos 2, sin 2 of the angle."""
    angles: Floats
    """(n,): where the edge was measured."""
    offsets_px: Floats
    """(n,): measured radius minus that of the curve."""
    support_ratio: float
    """Share of the rays inside the image that detected the edge."""
    blur_px: float
    """Standard deviation of the edge's blur."""

    @property
    def radius_px(self) -> float:
        """Mean radius."""
        return float(self.harmonics_px[0])

    @property
    def out_of_round_px(self) -> float:
        """Amplitude of the second harmonic: half the difference of an ellipse's semi-axes."""
        return float(math.hypot(*self.harmonics_px[3:]))

    @property
    def residual_px(self) -> float:
        """RMS of the measured offsets."""
        return float(np.sqrt(np.mean(self.offsets_px**2)))

    def radii_px(self, angles: Floats) -> Floats:
        """Return the radius of the curve at angles, (n,)."""
        return np.asarray(_basis(angles) @ self.harmonics_px)


class Rays(Struct, eq=False):
    """Gradient magnitude along rays from a centre."""

    center_px: Vec
    angles: Floats
    radii_px: Floats
    """Of the sampled circles; mean radii of the sampled curves, if they are shaped like an edge."""
    strength: Floats
    """(rays, radii), grey levels per px; nan outside the image."""


def rays_from(
    image: NDArray[np.float32], center: Vec, low_px: float, high_px: float, like: Edge | None = None
) -> Rays:
    """Sample the gradient magnitude along rays between two circles, or two curves shaped like an edge."""
    angles = np.arange(RAYS) * 2 * math.pi / RAYS
    radii = np.arange(low_px, high_px, STEP_PX)
    shape = like.radii_px(angles) / like.radius_px if like else np.ones(RAYS)
    x = (center[0] + np.outer(np.sin(angles) * shape, radii)).astype(np.float32)
    y = (center[1] + np.outer(np.cos(angles) * shape, radii)).astype(np.float32)
    samples = np.asarray(cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
    gradient = np.gradient(samples.astype(np.float64), STEP_PX, axis=1)
    strength = np.sqrt(np.mean(gradient**2, axis=2))
    height, width = image.shape[:2]
    strength[(x < 2) | (x > width - 3) | (y < 2) | (y > height - 3)] = np.nan
    return Rays(center, angles, radii, strength)


def edge_near(
    image: NDArray[np.float32],
    center: Vec,
    radius_px: float,
    reach_ratio: float = 0.04,
    like: Edge | None = None,
) -> Edge | None:
    """Fit the edge near a circle, or near a curve as out of round as another edge.

    Args:
        image: (h, w, 3), smoothed.
        center: Centre of the circle or curve [px].
        radius_px: Its mean radius.
        reach_ratio: Half width of the searched ring, relative to the radius.
        like: The other edge, if there is one.

    Returns:
        None if too few rays detect an edge.
    """
    harmonics = np.array([radius_px, 0.0, 0.0, 0.0, 0.0])
    if like is not None:
        harmonics[3:] = like.harmonics_px[3:] * radius_px / like.radius_px
    edge = None
    for reach_px in (max(reach_ratio * radius_px, 4.0), 4.0, 4.0):
        margin_px = reach_px + 3 * math.hypot(*harmonics[3:]) + 8
        rays = rays_from(image, center, max(harmonics[0] - margin_px, 2), harmonics[0] + margin_px)
        edge = _fit(rays, harmonics, reach_px)
        if edge is None:
            return None
        right, down = float(edge.harmonics_px[2]), float(edge.harmonics_px[1])
        center = center[0] + right, center[1] + down
        harmonics = edge.harmonics_px * np.array([1, 0, 0, 1, 1])
    return edge


def _fit(rays: Rays, harmonics: Floats, reach_px: float) -> Edge | None:
    expected = _basis(rays.angles) @ harmonics
    near = np.abs(rays.radii_px[None, :] - expected[:, None]) <= reach_px
    in_image = np.all(np.isfinite(rays.strength) | ~near, axis=1)
    if in_image.mean() < 0.3:
        return None
    strength = np.where(near & in_image[:, None], np.nan_to_num(rays.strength), 0.0)
    peaks_px, is_clear = _peaks(rays, strength)
    is_clear &= in_image
    if is_clear.sum() < MIN_SUPPORT / 2 * in_image.sum():
        return None
    angles, radii = rays.angles[is_clear], peaks_px[is_clear]
    fitted = _robust_fit(angles, radii)
    offsets = radii - _basis(angles) @ fitted
    close = np.abs(offsets) < INLIER_PX
    support = float(close.sum() / in_image.sum())
    if support < MIN_SUPPORT:
        return None
    blur_px = _edge_blur(rays, fitted, angles[close])
    return Edge(rays.center_px, fitted, angles[close], offsets[close], support, blur_px)


def _peaks(rays: Rays, strength: Floats) -> tuple[Floats, NDArray[np.bool_]]:
    """Return the sub-sample radius of each ray's gradient maximum [px], and whether it is an edge."""
    row = np.arange(len(strength))
    best = np.clip(strength.argmax(axis=1), 1, strength.shape[1] - 2)
    before, at, after = (strength[row, best + d] for d in (-1, 0, 1))
    is_peak = (at >= before) & (at >= after) & (before > 0) & (after > 0) & (at > MIN_EDGE_GREY)
    return rays.radii_px[best] + peak_offset(before, at, after) * STEP_PX, is_peak


def _robust_fit(angles: Floats, radii_px: Floats) -> Floats:
    """Fit the curve by RANSAC, then by least squares to its inliers."""
    basis = _basis(angles)
    rng = np.random.default_rng(0)
    samples = rng.integers(0, len(angles), (TRIALS, 5))
    square = basis[samples]
    is_solvable = np.abs(np.linalg.det(square)) > 0.05
    candidates = np.linalg.solve(square[is_solvable], radii_px[samples][is_solvable][..., None])[..., 0]
    candidates = np.vstack([candidates, [np.median(radii_px), 0, 0, 0, 0]])
    inliers = (np.abs(candidates @ basis.T - radii_px) < INLIER_PX).sum(axis=1)
    fitted = candidates[inliers.argmax()]
    for _ in range(5):
        close = np.abs(basis @ fitted - radii_px) < INLIER_PX
        if close.sum() < 10:
            break
        fitted = np.linalg.lstsq(basis[close], radii_px[close], rcond=None)[0]
    return np.asarray(fitted)


def _edge_blur(rays: Rays, fitted: Floats, angles: Floats) -> float:
    """Return the standard deviation of the edge's blur from its half width, without the smoothing [px]."""
    rows = np.rint(angles / (2 * math.pi) * RAYS).astype(int)
    offsets = np.arange(-8.0, 8.01, STEP_PX)
    expected = _basis(angles) @ fitted
    columns = np.rint((expected[:, None] + offsets - rays.radii_px[0]) / STEP_PX).astype(int)
    columns = np.clip(columns, 0, len(rays.radii_px) - 1)
    profile = np.nanmedian(rays.strength[rows[:, None], columns], axis=0)
    width_px = float((profile > profile.max() / 2).sum()) * STEP_PX
    return math.sqrt(max((width_px / 2.355) ** 2 - SMOOTHING_PX**2, 0.0))


def _basis(angles: Floats) -> Floats:
    return np.stack(
        [np.ones_like(angles), np.cos(angles), np.sin(angles), np.cos(2 * angles), np.sin(2 * angles)],
        axis=-1,
    )
