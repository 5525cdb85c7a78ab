"""Tell from the two edges of the wall how the camera looks at the plane they lie in.

Two circles about one centre, seen at a slant, are two ellipses whose middles lie apart: by their shape and
by that, a pinhole camera's angle and distance are fitted [px]. Knows neither images nor millimetres.
"""

import math

import numpy as np

from haptigraph.geometry import Vec
from haptigraph.imaging import Floats
from haptigraph.perception.anatomy.edge import Edge
from haptigraph.perception.anatomy.rim import Rim
from haptigraph.registration.tilt import Slant

__all__ = ["find_slant"]

LEAST_PX = 0.5  # below, a slant cannot be told from an edge's own faults
CLOSENESS = (0.15, 0.1)  # radius over the camera's distance: usual, and how far from it usual cameras are
MOST_CLOSENESS = 0.5
EDGE_SD_PX = 1.0  # of one ray; neighbours err alike
ROUNDS = 40


def find_slant(rim: Rim, middle_px: Vec) -> Slant | None:
    """Fit how the camera looks at the rim.

    Args:
        rim: Both edges of the wall.
        middle_px: Of the image, where the camera's axis is taken to be.

    Returns:
        None if it looks straight, as far as can be told, or the wall's outer edge is not seen.
    """
    if rim.outer is None:
        return None
    inner, outer = rim.inner, rim.outer
    apart_px = math.dist(inner.center_px, outer.center_px)
    if max(inner.out_of_round_px, outer.out_of_round_px, apart_px) < LEAST_PX:
        return None
    places = _places(inner), _places(outer)
    fits = [_fitted(start, places, middle_px) for start in _starts(inner, outer)]
    _, best = min(fits, key=lambda fit: fit[0])
    x, y, radius, right, down, closeness, _ = (float(value) for value in best)
    return Slant((x, y), (right, down), radius / closeness, middle_px)


def _places(edge: Edge) -> Floats:
    """Return where an edge was seen, (n, 2)."""
    radii = edge.radii_px(edge.angles) + edge.offsets_px
    way = np.stack([np.sin(edge.angles), np.cos(edge.angles)], axis=1)
    return np.asarray(np.array(edge.center_px) + radii[:, None] * way)


def _starts(inner: Edge, outer: Edge) -> list[Floats]:
    """Return guesses: tilted either way along the ellipse's short axis."""
    radius = inner.radius_px + inner.out_of_round_px
    # The long axis lies where the part of the radius with twice the angle is largest.
    _, _, _, a, b = inner.harmonics_px + outer.harmonics_px
    short = math.atan2(b, a) / 2 + math.pi / 2
    angle = math.sqrt(max(4 * inner.out_of_round_px / radius, 0.05**2))
    return [
        np.array(
            [
                *inner.center_px,
                radius,
                sign * angle * math.sin(short),
                sign * angle * math.cos(short),
                CLOSENESS[0],
                outer.radius_px / inner.radius_px,
            ]
        )
        for sign in (-1.0, 1.0)
    ]


def _fitted(start: Floats, places: tuple[Floats, Floats], middle_px: Vec) -> tuple[float, Floats]:
    """Return the least sum of squares and where it is, by damped Gauss-Newton steps."""
    values, damping = start, 1e-3
    off = _off(values, places, middle_px)
    steps = np.array([0.01, 0.01, 0.01, 1e-4, 1e-4, 1e-3, 1e-4])
    for _ in range(ROUNDS):
        slopes = np.stack(
            [
                (_off(values + step, places, middle_px) - _off(values - step, places, middle_px))
                / (2 * step.sum())
                for step in np.diag(steps)
            ],
            axis=1,
        )
        square = slopes.T @ slopes
        change = np.linalg.solve(square + damping * np.diag(np.diag(square)), -slopes.T @ off)
        tried = values + change
        tried[5] = min(max(tried[5], 1e-4), MOST_CLOSENESS)
        off_there = _off(tried, places, middle_px)
        if off_there @ off_there < off @ off:
            values, off, damping = tried, off_there, damping / 5
        else:
            damping *= 5
        if np.abs(change / steps).max() < 0.01:
            break
    return float(off @ off), values


def _off(values: Floats, places: tuple[Floats, Floats], middle_px: Vec) -> Floats:
    """Return how far the places lie off their circles in the straight picture [standard deviations]."""
    x, y, radius, right, down, closeness, wall = values
    tilt = Slant((x, y), (right, down), radius / closeness, middle_px)
    matrix = tilt.frontal_from_image.matrix
    usual, spread = CLOSENESS
    parts = [np.array([(closeness - usual) / spread])]
    for seen, circle in zip(places, (radius, wall * radius), strict=True):
        frontal = seen @ matrix[:, :2].T + matrix[:, 2]
        away = frontal[:, :2] / frontal[:, 2:] - (x, y)
        parts.append((np.hypot(away[:, 0], away[:, 1]) - circle) / EDGE_SD_PX)
    return np.concatenate(parts)
