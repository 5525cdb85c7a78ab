"""The gap between a point and a surface of a volume, with its standard deviation."""

import math
from typing import NamedTuple

import numpy as np

from haptigraph.imaging import Floats
from haptigraph.perception.volume.surfaces import HeightMap

NORMAL_MM = 0.1  # from a point to where a surface's slope is measured


class Gap(NamedTuple):
    """A signed distance from a surface along its local normal; positive above."""

    gap_mm: float
    sd_mm: float
    is_visible: bool
    """Whether the surface is visible within a cell of the point; otherwise it is interpolated."""


def gap_to(surface: HeightMap, point_mm: Floats, point_cov_mm2: Floats) -> Gap:
    """Return a point's signed distance from a surface along its local normal.

    Args:
        surface: The surface.
        point_mm: The point, (3,).
        point_cov_mm2: Its covariance, (3, 3).
    """
    x, y, z = (np.array(value) for value in point_mm)
    step = NORMAL_MM
    xs, zs = np.array([x + step, x - step, x, x]), np.array([z, z, z + step, z - step])
    right, left, near, far = surface.at(xs, zs)
    normal = np.array([-(right - left) / (2 * step), 1.0, -(near - far) / (2 * step)])
    normal /= np.linalg.norm(normal)
    off_mm = float(y - surface.at(x, z)) * float(normal[1])
    sd_mm = float(surface.at(x, z, surface.sd_mm)) * float(normal[1])
    visible = float(surface.at(x, z, surface.visible.astype(np.float64)))
    variance = float(normal @ point_cov_mm2 @ normal) + sd_mm**2
    return Gap(off_mm, math.sqrt(variance), visible > 0.5)
