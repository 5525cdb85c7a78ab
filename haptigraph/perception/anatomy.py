"""Find the static anatomy by itself: globe, retina and trocars in images of one set-up [px].

The wall's rim comes from `rim`, the needle's pivot from `pivot`. The rim that is seen may stand before the
plane in which the needle moves, and is then seen larger than the globe's section there; the pivot, which lies
in the middle of the wall and in that plane, tells by how much. Knows neither files nor millimetres.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np
from msgspec import Struct

from haptigraph.errors import BadInput
from haptigraph.geometry import Vec
from haptigraph.messages import Image
from haptigraph.perception.edge import Edge
from haptigraph.perception.pivot import Pivot, find_pivot, still_picture
from haptigraph.perception.rim import Rim, find_rim

__all__ = ["Anatomy", "FoundTrocar", "find_anatomy"]

RETINA_HALF_DEG = 75.0
RETINA_STEP_DEG = 1.5
REFINE_DEG = 3.0  # what was seen within so much either way counts for a contour point
REFINE_LEAST = 6
REFINE_MOST_PX = 3.0
RIM_BEFORE = 0.015  # likely size of how much larger the rim is seen
HOLE_HALF_DEG = 80.0  # from the top
HOLE_BAND = (0.968, 0.992)  # of the inner edge's radius, where the mouths of holes are seen
HOLE_DEG = 3.0
HOLE_APART_DEG = 14.0
HOLE_CLEAR = 6.0  # times the usual variation
HOLE_LEAST_GREY = 4.0
MOST_HOLES = 3


class FoundTrocar(Struct, frozen=True):
    """A trocar."""

    point_px: Vec
    """Middle of the wall, in the plane of the section."""
    angle_deg: float
    """From the top, positive to the image's right."""
    by: str
    """"needle" or "hole": what it was found by."""


class Anatomy(Struct, frozen=True, eq=False):
    """Everything found."""

    still: Image
    """The picture it was found in."""
    rim: Rim
    center_px: Vec
    """Of the globe's section."""
    radius_px: float
    contour_px: tuple[Vec, ...]
    """The retina, from the image's left over the bottom to its right."""
    refined: int
    """How many of its points were seen themselves; the others lie on the fitted curve."""
    trocars: tuple[FoundTrocar, ...]
    pivot: Pivot | None
    rim_ratio: float
    """How many times larger than the section the rim is seen."""


def find_anatomy(images: Sequence[Image]) -> Anatomy:
    """Find globe, retina and trocars.

    Args:
        images: At least one, all of one size, by a camera that stands still; with a moving needle at best.

    Raises:
        BadInput: If there is no eye, or it is cut off or blurred.
    """
    still = still_picture(images)
    rim = find_rim(still)
    pivot = find_pivot(images, rim) if len(images) > 1 else None
    _check_which_edge(rim, pivot)
    rim_ratio = _rim_ratio(rim, pivot)
    middle_x, middle_y = (still.shape[1] - 1) / 2, (still.shape[0] - 1) / 2

    def section(at_px: Vec) -> Vec:
        return (
            middle_x + (at_px[0] - middle_x) / rim_ratio,
            middle_y + (at_px[1] - middle_y) / rim_ratio,
        )

    contour, refined = _contour(rim.inner)
    return Anatomy(
        still=still,
        rim=rim,
        center_px=section(rim.inner.center_px),
        radius_px=rim.inner.radius_px / rim_ratio,
        contour_px=tuple(section(point) for point in contour),
        refined=refined,
        trocars=_trocars(still, rim, pivot, section(rim.inner.center_px), rim.middle_px / rim_ratio),
        pivot=pivot,
        rim_ratio=rim_ratio,
    )


def _check_which_edge(rim: Rim, pivot: Pivot | None) -> None:
    """Refuse a single edge that may be the wall's outer one: a needle pivots outside the inner edge."""
    if rim.outer is not None:
        return
    is_inner = pivot is not None and math.dist(pivot.point_px, rim.inner.center_px) > rim.inner.radius_px
    if not is_inner:
        raise BadInput(
            "only one edge of the globe's wall can be seen, and nothing shows that it is the inner one; "
            "more light, a sharper image or a clip with a moving needle would"
        )


def _rim_ratio(rim: Rim, pivot: Pivot | None) -> float:
    """Tell how much larger than the section the rim is seen: 1 unless the pivot says otherwise.

    Weighed by how sure the pivot's depth in the wall is. Never less than 1: the wall hides the needle.
    """
    if pivot is None or rim.outer is None:
        return 1.0
    seen = rim.middle_px / math.dist(pivot.point_px, rim.inner.center_px) - 1
    doubt = pivot.radial_sd_px / rim.inner.radius_px
    return 1 + min(max(seen * RIM_BEFORE**2 / (RIM_BEFORE**2 + doubt**2), 0.0), 3 * RIM_BEFORE)


def _contour(edge: Edge) -> tuple[list[Vec], int]:
    """Return the lower part of the inner edge, moved to where it was seen, and for how many points it was."""
    steps = round(2 * RETINA_HALF_DEG / RETINA_STEP_DEG)
    angles = np.radians(np.linspace(-RETINA_HALF_DEG, RETINA_HALF_DEG, steps + 1))
    radii = edge.radii_px(angles)
    apart = (edge.angles[None, :] - angles[:, None] + math.pi) % (2 * math.pi) - math.pi
    refined = 0
    for row, near in enumerate(np.abs(apart) < math.radians(REFINE_DEG)):
        if near.sum() >= REFINE_LEAST:
            refined += 1
            radii[row] += np.clip(np.median(edge.offsets_px[near]), -REFINE_MOST_PX, REFINE_MOST_PX)
    x = edge.center_px[0] + radii * np.sin(angles)
    y = edge.center_px[1] + radii * np.cos(angles)
    return [(float(a), float(b)) for a, b in zip(x, y, strict=True)], refined


def _trocars(
    still: Image, rim: Rim, pivot: Pivot | None, center: Vec, middle_px: float
) -> tuple[FoundTrocar, ...]:
    """Return the trocar the needle moves in, then those whose holes are seen, clearest first."""
    found: list[FoundTrocar] = []
    if pivot is not None:
        right, down = pivot.point_px[0] - center[0], pivot.point_px[1] - center[1]
        found.append(FoundTrocar(pivot.point_px, math.degrees(math.atan2(right, -down)), "needle"))
    for angle_deg in _holes(still, rim):
        angle = math.radians(angle_deg)
        place = center[0] + middle_px * math.sin(angle), center[1] - middle_px * math.cos(angle)
        if all(abs(other.angle_deg - angle_deg) > HOLE_APART_DEG for other in found):
            found.append(FoundTrocar(place, angle_deg, "hole"))
    return tuple(found[:MOST_HOLES])


def _holes(still: Image, rim: Rim) -> list[float]:
    """Return the angles [deg from the top] at which the mouth of a hole is seen inside the wall."""
    step_deg = 0.25
    angles_deg = np.arange(-HOLE_HALF_DEG - 10, HOLE_HALF_DEG + 10 + step_deg, step_deg)
    angles = np.radians(angles_deg)
    edge = rim.inner
    radii = edge.radii_px(math.pi - angles)[:, None] * np.linspace(*HOLE_BAND, 9)
    x = (edge.center_px[0] + radii * np.sin(angles)[:, None]).astype(np.float32)
    y = (edge.center_px[1] - radii * np.cos(angles)[:, None]).astype(np.float32)
    color = still if still.ndim == 3 else cv2.cvtColor(still, cv2.COLOR_GRAY2BGR)
    tone = np.asarray(cv2.remap(color, x, y, cv2.INTER_LINEAR)).astype(np.float64).mean(axis=1)
    half = round(10 / step_deg)
    around = np.array([np.median(tone[max(i - half, 0) : i + half + 1], axis=0) for i in range(len(tone))])
    away = cv2.blur(tone - around, (1, round(HOLE_DEG / step_deg)))
    size = np.hypot(np.hypot(away[:, 0], away[:, 1]), away[:, 2]) / math.sqrt(3)
    usual = max(float(np.median(size)), HOLE_LEAST_GREY / HOLE_CLEAR)
    size[np.abs(angles_deg) > HOLE_HALF_DEG] = 0
    holes: list[float] = []
    while len(holes) < MOST_HOLES and size.max() > HOLE_CLEAR * usual:
        at = float(angles_deg[size.argmax()])
        near = np.abs(angles_deg - at) < HOLE_APART_DEG / 2
        weight = size * near
        holes.append(float((angles_deg * weight).sum() / weight.sum()))
        size[np.abs(angles_deg - at) < HOLE_APART_DEG] = 0
    return holes
