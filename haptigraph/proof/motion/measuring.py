"""The measures of a needle at many poses at once, as `scene.relations` defines them for one."""

from collections.abc import Callable
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from haptigraph.geometry import Circle, Geometry, Point, Polyline, Vec
from haptigraph.graph import Relation
from haptigraph.proof.motion.needle import LINE, TIP, Needle
from haptigraph.scene.relations import MEASURES, Found

__all__ = ["Measuring", "measuring_of"]

Array = NDArray[np.float64]
Measuring = Callable[[Array, Array], Array]
"""From tips [mm] and directions of the shaft, (2, n) each, to a measure, (n,)."""
Number = TypeVar("Number", np.float64, np.bool_)
UNMOVED = ("elapsed_s", "tip_disagreement_mm")  # time stands still, and the robot moves with its needle
BATCH = 1 << 17  # distances to segments that are computed at once: few enough for the cache


def measuring_of(relation: Relation, needle: Needle, found: Found) -> Measuring | None:
    """Return how to measure a relation at many poses of the needle.

    Args:
        relation: The relation.
        needle: The needle.
        found: The entities of the graph, where they are.

    Returns:
        None if the measure is undefined, as an entity that it requires is missing.

    Raises:
        ValueError: If its change with the needle's motion is not known.
    """
    subject, object_ = found.get(relation.subject), found.get(relation.object)
    if subject is None or object_ is None:
        return None
    value = MEASURES[relation.measure].function(subject, object_, found)
    if value is None:
        return None
    shape = MEASURES[relation.measure].shapes.get((_shape(subject), _shape(object_)))
    needed = {relation.subject, relation.object, *(shape.requires if shape else ())}
    if relation.measure in UNMOVED or not needed & {TIP, LINE}:
        return lambda tips, along: np.full(tips.shape[1], value)
    make = _MEASURINGS.get((relation.measure, relation.subject, type(object_)))
    if make is None:
        names = ", ".join(relation.names)
        raise ValueError(f"how {relation.measure} of <{names}> changes with the needle is not known")
    return make(object_, needle, found)


def _shape(geometry: Geometry) -> str:
    return type(geometry).__name__.lower()


def _to_point(object_: Geometry, needle: Needle, found: Found) -> Measuring:
    object_ = cast(Point, object_)
    x, y = object_.at_mm
    return lambda tips, along: np.hypot(tips[0] - x, tips[1] - y)


def _to_surface(object_: Geometry, needle: Needle, found: Found) -> Measuring:
    object_ = cast(Polyline, object_)
    trocar_mm = needle.trocar_mm

    def signed(tips: Array, along: Array) -> Array:
        gaps = _in_batches(lambda each: _gaps(each, object_), tips, object_)
        crossed = _in_batches(lambda each: _crosses(trocar_mm, each, object_), tips, object_)
        return np.where(crossed, -gaps, gaps)

    return signed


def _radial(object_: Geometry, needle: Needle, found: Found) -> Measuring:
    object_ = cast(Point, object_)
    axis = np.subtract(object_.at_mm, needle.trocar_mm)
    u, v = axis / np.hypot(*axis)
    x, y = needle.trocar_mm
    return lambda tips, along: np.abs(u * (tips[1] - y) - v * (tips[0] - x))


def _theta(object_: Geometry, needle: Needle, found: Found) -> Measuring:
    object_ = cast(Point, object_)
    u, v = np.subtract(object_.at_mm, needle.trocar_mm)

    def theta(tips: Array, along: Array) -> Array:
        cross, dot = along[0] * v - along[1] * u, along[0] * u + along[1] * v
        angles: Array = np.degrees(np.arctan2(np.abs(cross), dot))
        return angles

    return theta


def _to_wall(object_: Geometry, needle: Needle, found: Found) -> Measuring:
    object_ = cast(Circle, object_)
    x, y = object_.center_mm
    return lambda tips, along: object_.radius_mm - np.hypot(tips[0] - x, tips[1] - y)


def _aside(object_: Geometry, needle: Needle, found: Found) -> Measuring:
    object_ = cast(Circle, object_)
    axis = Polyline((needle.globe.center_mm, object_.center_mm))
    return lambda tips, along: _gaps(tips, axis) - object_.radius_mm


_MEASURINGS: dict[tuple[str, str, type], Callable[[Geometry, Needle, Found], Measuring]] = {
    ("distance_mm", TIP, Point): _to_point,
    ("distance_mm", TIP, Polyline): _to_surface,
    ("radial_mm", TIP, Point): _radial,
    ("theta_deg", LINE, Point): _theta,
    ("wall_mm", TIP, Circle): _to_wall,
    ("aside_mm", TIP, Circle): _aside,
}
"""By measure, subject and shape of the object."""


def _in_batches(function: Callable[[Array], NDArray[Number]], tips: Array, line: Polyline) -> NDArray[Number]:
    step = max(BATCH // len(line.points_mm), 1)
    batches = [function(tips[:, start : start + step]) for start in range(0, tips.shape[1], step)]
    return np.concatenate(batches)


def _gaps(tips: Array, line: Polyline) -> Array:
    """Return the distances from points, (2, n), to a polyline, (n,)."""
    (x, y), (dx, dy, squared) = line.columns_mm, line.steps_mm
    from_x, from_y = tips[0][:, None] - x[:-1], tips[1][:, None] - y[:-1]
    fraction = np.clip((from_x * dx + from_y * dy) / squared, 0.0, 1.0)
    from_x -= fraction * dx
    from_y -= fraction * dy
    gaps: Array = np.sqrt((from_x * from_x + from_y * from_y).min(axis=1))
    return gaps


def _crosses(start_mm: Vec, tips: Array, line: Polyline) -> NDArray[np.bool_]:
    """Return whether the segments from a point to many, (2, n), cross a polyline, (n,)."""
    (x, y), (dx, dy, _) = line.columns_mm, line.steps_mm
    path_x, path_y = tips[0][:, None] - start_mm[0], tips[1][:, None] - start_mm[1]
    is_left = path_x * (y - start_mm[1]) - path_y * (x - start_mm[0]) > 0
    before = dx * (start_mm[1] - y[:-1]) - dy * (start_mm[0] - x[:-1])
    after = dx * (tips[1][:, None] - y[:-1]) - dy * (tips[0][:, None] - x[:-1])
    crosses: NDArray[np.bool_] = ((is_left[:, :-1] != is_left[:, 1:]) & (before * after < 0)).any(axis=1)
    return crosses
