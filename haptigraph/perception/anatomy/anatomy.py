"""Find the static anatomy by itself: globe, retina and trocars in images of one set-up [px].

The wall's rim comes from `rim`, the needle's pivot from `moving_shaft` and again from `tracked_rcm`. The
rim that is seen may stand before the plane in which the needle moves, and is then seen larger than the
globe's section there; what lies in that plane tells by how much: the pivot, in the middle of the wall, and
the port openings (`port_opening`). The camera's tilt comes from the rim (`camera_tilt`); all else is found in
the frontal view. Knows neither files nor millimetres.
"""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from haptigraph.errors import BadInput
from haptigraph.geometry import Vec, subtract, unit
from haptigraph.imaging import tilt_corrected
from haptigraph.messages import Image
from haptigraph.perception.anatomy.camera_tilt import find_slant
from haptigraph.perception.anatomy.edge import Edge
from haptigraph.perception.anatomy.moving_shaft import find_rcms, still_picture
from haptigraph.perception.anatomy.port_opening import (
    APART_DEG,
    MOST_OPENINGS,
    WHITE_GREY,
    PortOpening,
    find_port_openings,
)
from haptigraph.perception.anatomy.rcm import Rcm
from haptigraph.perception.anatomy.rim import Rim, find_rim
from haptigraph.perception.anatomy.tracked_rcm import tracked_rcm
from haptigraph.registration.tilt import Slant

__all__ = ["Anatomy", "FoundTrocar", "find_anatomy"]

RETINA_HALF_DEG = 75.0
RETINA_STEP_DEG = 1.5
REFINE_DEG = 3.0  # what was seen within so much either way counts for a contour point
REFINE_LEAST = 6
REFINE_MOST_PX = 3.0
RIM_BEFORE = 0.015  # likely size of how much larger the rim is seen
RIM_HEIGHT = 0.08  # and of how far before the section it stands, of the radius
RCM_OFF = 0.004  # of the radius: a trocar need not sit exactly in the middle of the wall
OPENING_OFF_PX = 0.7
MOST_WHITE = 0.5  # share of what lies within a single edge


class FoundTrocar(Struct, frozen=True):
    """A trocar."""

    point_px: Vec
    """Middle of the wall, in the plane of the section."""
    angle_deg: float
    """From the top, positive to the image's right."""
    rcm: Rcm | None
    """Where something like a needle turned in it; None if only its hole was seen."""


class Anatomy(Struct, frozen=True, eq=False):
    """Everything found; places lie in the straightened picture, where there is a slant."""

    still: Image
    """The picture it was found in, as the camera took it."""
    tilt: Slant | None
    """How the camera looks at the section; None: straight, as far as can be told."""
    rim: Rim
    center_px: Vec
    """Of the globe's section."""
    radius_px: float
    contour_px: tuple[Vec, ...]
    """The retina, from the image's left over the bottom to its right."""
    refined: int
    """How many of its points were seen themselves; the others lie on the fitted curve."""
    trocars: tuple[FoundTrocar, ...]
    """First those in which something moves."""
    rim_ratio: float
    """How many times larger than the section the rim is seen."""
    rim_uncertainty_px: float
    """Standard deviation of what that makes of globe and retina at worst."""
    rim_by: tuple[str, ...]
    """What told it: "needle", "port_openings" or nothing."""

    def seen_px(self, frontal_px: Vec) -> Vec:
        """Return where the camera sees a place of the straightened picture."""
        return self.tilt.image_from_frontal(frontal_px) if self.tilt else frontal_px

    def frontal_px(self, seen_px: Vec) -> Vec:
        """Return where a place that the camera sees lies in the straightened picture."""
        return self.tilt.frontal_from_image(seen_px) if self.tilt else seen_px


def find_anatomy(images: Sequence[Image]) -> Anatomy:
    """Find globe, retina and trocars.

    Args:
        images: At least one, all of one size, by a camera that stands still; with a moving needle at best.

    Raises:
        BadInput: If there is no eye, or it is cut off or blurred.
    """
    taken = still = still_picture(images)
    middle_px = (still.shape[1] - 1) / 2, (still.shape[0] - 1) / 2
    rim = find_rim(still)
    tilt = find_slant(rim, middle_px)
    if tilt is not None:
        way = tilt.frontal_from_image
        still, images = tilt_corrected(still, way), [tilt_corrected(image, way) for image in images]
        rim = find_rim(still)
    foot_x, foot_y = tilt.foot_px if tilt else middle_px
    rough = find_rcms(images, still, rim) if len(images) > 1 else ()
    rcms = [rcm.and_again(tracked_rcm(images, rim, rcm.point_px)) for rcm in rough]
    _check_which_edge(rim, rcms, still)
    port_openings = find_port_openings(still, rim.inner)
    before, doubt, rim_by = _rim_before(rim, rcms, port_openings, tilt, (foot_x, foot_y))
    rim_ratio = 1 + before

    def section(at_px: Vec) -> Vec:
        return foot_x + (at_px[0] - foot_x) / rim_ratio, foot_y + (at_px[1] - foot_y) / rim_ratio

    contour, refined = _contour(rim.inner)
    return Anatomy(
        still=taken,
        tilt=tilt,
        rim=rim,
        center_px=section(rim.inner.center_px),
        radius_px=rim.inner.radius_px / rim_ratio,
        contour_px=tuple(section(point) for point in contour),
        refined=refined,
        trocars=_trocars(port_openings, rcms, section(rim.inner.center_px), rim.middle_px / rim_ratio),
        rim_ratio=rim_ratio,
        rim_uncertainty_px=doubt
        * math.hypot(rim.inner.radius_px, *subtract(rim.inner.center_px, (foot_x, foot_y))),
        rim_by=rim_by,
    )


def _check_which_edge(rim: Rim, rcms: Sequence[Rcm], still: Image) -> None:
    """Refuse a single edge that may be the wall's outer one: a needle pivots outside the inner edge."""
    if rim.outer is not None:
        return
    white = _white_share(rim, still)
    if white > MOST_WHITE:
        raise BadInput(
            f"the eye is overexposed: {white:.0%} of it is white, and only one edge of its wall can be seen; "
            "less light or a shorter exposure would show the other"
        )
    away_px = [math.dist(rcm.point_px, rim.inner.center_px) for rcm in rcms]
    if min(away_px, default=0.0) <= rim.inner.radius_px:
        raise BadInput(
            "only one edge of the globe's wall can be seen, and nothing shows that it is the inner one; "
            "more light, a sharper image or a clip with a moving needle would"
        )


def _white_share(rim: Rim, still: Image) -> float:
    """Return how much of what lies within the edge is as bright as can be."""
    y, x = np.ogrid[: still.shape[0], : still.shape[1]]
    (center_x, center_y), radius_px = rim.inner.center_px, rim.inner.radius_px
    within = still[(x - center_x) ** 2 + (y - center_y) ** 2 < radius_px**2]
    darkest = within if within.ndim == 1 else within.min(axis=1)
    return float(np.mean(darkest >= WHITE_GREY))


def _rim_before(
    rim: Rim, rcms: Sequence[Rcm], port_openings: Sequence[PortOpening], tilt: Slant | None, foot_px: Vec
) -> tuple[float, float, tuple[str, ...]]:
    """Tell by what share larger than the section the rim is seen, its deviation, and what told it.

    Estimated from the needle's RCM and the port openings, weighted by their uncertainty.
    Never less than 0: the wall hides the needle.
    """
    center, radius_px = rim.inner.center_px, rim.inner.radius_px
    usual = min(RIM_BEFORE, RIM_HEIGHT * radius_px / tilt.focal_px) if tilt else RIM_BEFORE
    known: list[tuple[float, float]] = [(0.0, usual)]
    by: list[str] = []

    def told_by(place: Vec, circle_px: float, uncertainty_px: float) -> tuple[float, float]:
        outwards, away = unit(subtract(place, center)), subtract(place, foot_px)
        lever_px = max(abs(away[0] * outwards[0] + away[1] * outwards[1]), 1.0)
        return _before(place, circle_px, center, foot_px), uncertainty_px / lever_px

    for rcm in rcms if rim.outer is not None else ():
        uncertainty_px = math.hypot(rcm.radial_sd_px, RCM_OFF * radius_px)
        known.append(told_by(rcm.point_px, rim.middle_px, uncertainty_px))
        by += ["needle"] if known[-1][1] < usual and not by else []
    told = [
        told_by(
            _around(center, radius_px - port_opening.inside_px, port_opening.angle_deg),
            radius_px,
            OPENING_OFF_PX,
        )
        for port_opening in port_openings
        if port_opening.inside_px is not None
    ]
    # A reflection or another instrument may look like a mouth, but not like two that agree.
    agreeing = [
        one
        for number, one in enumerate(told)
        if any(
            abs(one[0] - other[0]) < 2 * max(one[1], other[1]) for other in told[:number] + told[number + 1 :]
        )
    ]
    known += agreeing
    by += ["port_openings"] if agreeing else []
    weights = [1 / doubt**2 for _, doubt in known]
    before = sum(weight * seen for weight, (seen, _) in zip(weights, known, strict=True)) / sum(weights)
    return min(max(before, 0.0), 3 * usual), 1 / math.sqrt(sum(weights)), tuple(by)


def _before(at_px: Vec, radius_px: float, center_px: Vec, foot_px: Vec) -> float:
    """Return by what share a circle must shrink towards the camera's foot to pass through a place."""
    (ax, ay), (bx, by) = ((x - foot_px[0], y - foot_px[1]) for x, y in (at_px, center_px))
    square, along = ax * ax + ay * ay, ax * bx + ay * by
    inner = along * along - square * (bx * bx + by * by - radius_px * radius_px)
    root = math.sqrt(max(inner, 0.0))
    return min(((along + sign * root) / square - 1 for sign in (1, -1)), key=abs)


def _around(center_px: Vec, radius_px: float, angle_deg: float) -> Vec:
    """Return the place at an angle from the top."""
    angle = math.radians(angle_deg)
    return center_px[0] + radius_px * math.sin(angle), center_px[1] - radius_px * math.cos(angle)


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
    port_openings: Sequence[PortOpening], rcms: Sequence[Rcm], center_px: Vec, middle_px: float
) -> tuple[FoundTrocar, ...]:
    """Return the trocar the needle moves in, then those whose holes are seen, clearest first."""
    found: list[FoundTrocar] = []
    for rcm in rcms:
        right, down = rcm.point_px[0] - center_px[0], rcm.point_px[1] - center_px[1]
        found.append(FoundTrocar(rcm.point_px, math.degrees(math.atan2(right, -down)), rcm))
    for port_opening in port_openings:
        if all(abs(other.angle_deg - port_opening.angle_deg) > APART_DEG for other in found):
            place = _around(center_px, middle_px, port_opening.angle_deg)
            found.append(FoundTrocar(place, port_opening.angle_deg, None))
    return tuple(found[:MOST_OPENINGS])
