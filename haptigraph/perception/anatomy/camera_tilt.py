"""Estimate the camera's tilt from the two edges of the wall [px].

A tilted view turns two concentric circles into two ellipses with different centres. Their shapes and the
offset of their centres determine the angle and the distance of a pinhole camera.
"""

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats
from haptigraph.perception.anatomy.edge import Edge
from haptigraph.perception.anatomy.expected import Expected
from haptigraph.perception.anatomy.rim import Rim
from haptigraph.registration.tilt import CameraTilt

__all__ = ["Prior", "edge_points", "find_camera_tilt", "fit_circles"]

MIN_DEVIATION_PX = 0.5  # from concentric circles, before any lens; less may be irregularity of an edge
MIN_CHI_SQUARE = 13.8  # before a calibrated lens: without a tilt, one picture in 1,000 has more
FLAT_SD_RAD = 1e-6
CLOSENESS_PRIOR = (0.15, 0.1)  # mean and standard deviation of globe radius / camera distance
KNOWN_CLOSENESS_SD = 0.005  # with a calibrated focal length; the rim may lie in front of the section
MAX_CLOSENESS = 0.5
EDGE_SD_PX = 1.0  # of one ray; the errors of neighbours are correlated
REPEATED_RAYS = 30  # so many neighbours share one error: a prior of the design counts against fewer rays
MAX_ITERATIONS = 40


class Prior(Struct, frozen=True):
    """What is known of a camera before its image."""

    closeness: tuple[float, float] = CLOSENESS_PRIOR
    tilt_sd_rad: float = math.inf

    @classmethod
    def of(cls, expected: Expected | None, closeness: float | None) -> "Prior":
        """Return what the design says, on the scale of rays that repeat their neighbours' errors.

        Args:
            expected: The anatomy as designed, if known.
            closeness: By a calibrated focal length, if there is one.
        """
        known = CLOSENESS_PRIOR if closeness is None else (closeness, KNOWN_CLOSENESS_SD)
        if expected is None:
            return cls(known)
        share = 1 / math.sqrt(REPEATED_RAYS)
        if closeness is None:
            known = expected.closeness, expected.closeness_sd * share
        return cls(known, math.radians(expected.tilt_sd_deg) * share)


def find_camera_tilt(
    rim: Rim, principal_px: Vec, expected: Expected | None = None, focal_px: float | None = None
) -> CameraTilt | None:
    """Fit the camera's tilt to the rim.

    Args:
        rim: Both edges of the wall.
        principal_px: The principal point; without a calibration, that is assumed at the image centre.
        expected: The anatomy as designed, if known.
        focal_px: The focal length, if it was calibrated.

    Returns:
        None if no tilt is measurable, or the outer edge of the wall was not detected.
    """
    if rim.outer is None:
        return None
    inner, outer = rim.inner, rim.outer
    offset_px = math.dist(inner.center_px, outer.center_px)
    deviation_px = max(inner.out_of_round_px, outer.out_of_round_px, offset_px)
    if focal_px is None and deviation_px < MIN_DEVIATION_PX:
        return None
    points = edge_points(inner), edge_points(outer)
    prior = Prior.of(expected, inner.radius_px / focal_px if focal_px else None)
    starts = _initial_guesses(inner, outer, CLOSENESS_PRIOR[0] if focal_px is None else prior.closeness[0])
    fits = [fit_circles(start, points, principal_px, prior) for start in starts]
    cost, best = min(fits, key=lambda fit: fit[0])
    if focal_px is not None:
        flat = replace(prior, tilt_sd_rad=FLAT_SD_RAD)
        flat_cost, _ = fit_circles(best * (1, 1, 1, 0, 0, 1, 1), points, principal_px, flat)
        independent_rays = sum(map(len, points)) / REPEATED_RAYS
        if (flat_cost - cost) * independent_rays < MIN_CHI_SQUARE * cost:
            return None
    x, y, radius, right, down, closeness, _ = (float(value) for value in best)
    return CameraTilt((x, y), (right, down), radius / closeness, principal_px)


def edge_points(edge: Edge) -> Floats:
    """Return the measured points of an edge, (n, 2)."""
    radii = edge.radii_px(edge.angles) + edge.offsets_px
    directions = np.stack([np.sin(edge.angles), np.cos(edge.angles)], axis=1)
    return np.asarray(np.array(edge.center_px) + radii[:, None] * directions)


def _initial_guesses(inner: Edge, outer: Edge, closeness: float) -> list[Floats]:
    """Return initial parameters: tilted in either direction along the ellipse's minor axis."""
    radius = inner.radius_px + inner.out_of_round_px
    # The major axis is where the second harmonic of the radius has its maximum.
    _, _, _, a, b = inner.harmonics_px + outer.harmonics_px
    minor = math.atan2(b, a) / 2 + math.pi / 2
    angle = math.sqrt(max(4 * inner.out_of_round_px / radius, 0.05**2))
    return [
        np.array(
            [
                *inner.center_px,
                radius,
                sign * angle * math.sin(minor),
                sign * angle * math.cos(minor),
                closeness,
                outer.radius_px / inner.radius_px,
            ]
        )
        for sign in (-1.0, 1.0)
    ]


def fit_circles(
    start: Floats,
    points: tuple[Floats, Floats],
    principal_px: Vec,
    prior: Prior,
    iterations: int = MAX_ITERATIONS,
) -> tuple[float, Floats]:
    """Minimise the sum of squares with damped Gauss-Newton steps; return it and the parameters."""
    values, damping = start, 1e-3
    residuals = _residuals(values, points, principal_px, prior)
    steps = np.array([0.01, 0.01, 0.01, 1e-4, 1e-4, 1e-3, 1e-4])

    def slope(step: Floats) -> Floats:
        after = _residuals(values + step, points, principal_px, prior)
        before = _residuals(values - step, points, principal_px, prior)
        return np.asarray((after - before) / (2 * step.sum()))

    for _ in range(iterations):
        jacobian = np.stack([slope(step) for step in np.diag(steps)], axis=1)
        normal = jacobian.T @ jacobian
        change = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -jacobian.T @ residuals)
        candidate = values + change
        candidate[5] = min(max(candidate[5], 1e-4), MAX_CLOSENESS)
        new_residuals = _residuals(candidate, points, principal_px, prior)
        if new_residuals @ new_residuals < residuals @ residuals:
            values, residuals, damping = candidate, new_residuals, damping / 5
        else:
            damping *= 5
        if np.abs(change / steps).max() < 0.01:
            break
    return float(residuals @ residuals), values


def _residuals(values: Floats, points: tuple[Floats, Floats], principal_px: Vec, prior: Prior) -> Floats:
    """Return the distances of the points from their circles in the frontal view [standard deviations]."""
    x, y, radius, right, down, closeness, wall = values
    tilt = CameraTilt((x, y), (right, down), radius / closeness, principal_px)
    homography = tilt.frontal_from_image
    mean, sd = prior.closeness
    parts = [np.array([(closeness - mean) / sd, right / prior.tilt_sd_rad, down / prior.tilt_sd_rad])]
    for of_edge, circle in zip(points, (radius, wall * radius), strict=True):
        offset = homography.many(of_edge) - (x, y)
        parts.append((np.hypot(offset[:, 0], offset[:, 1]) - circle) / EDGE_SD_PX)
    return np.concatenate(parts)
