"""How far the distortion of a lens that nobody calibrated may put registered points off [px].

For every plausible distortion the rim is undistorted and the camera's tilt fitted again. How well that fits,
and how plausible the distortion is, weights the error that it would mean: the largest distance of a
point of the section from where the registration has it. A single coefficient about the image's centre
describes the lens (A. W. Fitzgibbon, "Simultaneous linear estimation of multiple view geometry and lens
distortion", CVPR 2001).
"""

import math

import numpy as np

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats
from haptigraph.perception.anatomy.camera_tilt import Prior, edge_points, fit_circles
from haptigraph.perception.anatomy.rim import Rim
from haptigraph.registration.tilt import CameraTilt

__all__ = ["lens_risk_px"]

SHARES = np.linspace(-0.12, 0.12, 7)
"""Distortions in the middle of the image's side; negative: barrel."""
SHARE_SD = 0.05
FITTING_PX2 = 4.0
"""Sum of squares that counts as one observation, because the errors of neighbouring rays are correlated."""
PROBABILITY = 0.95
FINE = 97  # distortions between which costs and errors are interpolated
EVERY = 6  # rays
ITERATIONS = 10
RINGS, SPOKES = np.array([0.0, 0.3, 0.6, 0.8, 1.0]), 16
GUESSED_TILT_RAD, GUESSED_CLOSENESS = 0.02, 0.15
OPPOSITE = np.array([1, 1, 1, -1, -1, 1, 1])
"""Turns a tilt round, among the parameters of `fit_circles`: distortion decides between the two."""


def lens_risk_px(rim: Rim, tilt: CameraTilt | None, size_px: tuple[int, int]) -> float:
    """Return the error that an uncalibrated lens does not exceed with a probability of 95 %.

    Args:
        rim: The rim, in the frontal view if there is a tilt.
        tilt: The camera's tilt as registered.
        size_px: (width, height) of the images.
    """
    shares = np.linspace(SHARES[0], SHARES[-1], FINE)
    cost, error_px = (np.interp(shares, SHARES, each) for each in _costs_and_errors(rim, tilt, size_px))
    log = -(cost / FITTING_PX2 + (shares / SHARE_SD) ** 2) / 2
    weights = np.exp(log - log.max())
    order = np.argsort(error_px)
    below = np.cumsum(weights[order]) / weights.sum()
    return float(error_px[order][np.searchsorted(below, PROBABILITY)])


def _costs_and_errors(rim: Rim, tilt: CameraTilt | None, size_px: tuple[int, int]) -> tuple[Floats, Floats]:
    """Return how badly each of `SHARES` fits the rim, and the largest error that it would mean [px]."""
    inner, outer = rim.inner, rim.outer or rim.inner
    middle = (size_px[0] - 1) / 2, (size_px[1] - 1) / 2
    turns = np.linspace(0, 2 * math.pi, SPOKES, endpoint=False)
    disc = (RINGS[:, None, None] * np.stack([np.cos(turns), np.sin(turns)], axis=1)).reshape(-1, 2)
    inner_px, outer_px, disc_px = (
        tilt.image_from_frontal.many(points) if tilt else points
        for points in (
            edge_points(inner)[::EVERY],
            edge_points(outer)[::EVERY],
            np.array(inner.center_px) + inner.radius_px * disc,
        )
    )
    guess = tilt or CameraTilt(inner.center_px, (0.0, 0.0), inner.radius_px / GUESSED_CLOSENESS, middle)
    right, down = guess.tilt_rad if tilt else (GUESSED_TILT_RAD, GUESSED_TILT_RAD)
    radius = inner.radius_px
    wall, closeness = outer.radius_px / radius, min(radius / guess.focal_px, 2 * GUESSED_CLOSENESS)
    first = np.array([*inner.center_px, radius, right, down, closeness, wall])
    starts = {len(SHARES) // 2: first}
    rows: dict[int, tuple[float, float]] = {}
    outwards = sorted(range(len(SHARES)), key=lambda number: abs(number - len(SHARES) // 2))
    for number in outwards:  # each fit starts from its neighbour's
        share = float(SHARES[number])
        points = _undistorted(inner_px, share, middle), _undistorted(outer_px, share, middle)
        both = starts[number], starts[number] * OPPOSITE
        fits = [fit_circles(start, points, middle, Prior(), ITERATIONS) for start in both]
        cost, values = min(fits, key=lambda fit: fit[0])
        starts.setdefault(number - 1, values)
        starts.setdefault(number + 1, values)
        offsets = _section_positions(_undistorted(disc_px, share, middle), values, middle) - disc
        rows[number] = cost, float(np.hypot(*offsets.T).max()) * inner.radius_px
    costs, errors_px = np.array([rows[number] for number in range(len(SHARES))]).T
    return costs, errors_px


def _section_positions(points_px: Floats, values: Floats, middle_px: Vec) -> Floats:
    """Return where points are in the section [radii of the globe], by the parameters of `fit_circles`."""
    x, y, radius, right, down, closeness, _ = map(float, values)
    tilt = CameraTilt((x, y), (right, down), radius / closeness, middle_px)
    return np.asarray((tilt.frontal_from_image.many(points_px) - (x, y)) / radius)


def _undistorted(points_px: Floats, share: float, middle_px: Vec) -> Floats:
    """Return points without a distortion that moves the middle of the image's side by a share."""
    offset = points_px - middle_px
    squared = (offset**2).sum(axis=1, keepdims=True) / (middle_px[0] + 0.5) ** 2
    return np.asarray(middle_px + offset / (1 + share * squared))
