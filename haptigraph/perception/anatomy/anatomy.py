"""Find the static anatomy automatically: globe, retina and trocars in images of one set-up [px].

`rim` finds the wall's rim, `camera_tilt` the camera's tilt from it; everything else is found in the frontal
view. `moving_shaft` finds the needle's remote centre of motion (RCM), `tracked_rcm` refines it. A rim in
front of the plane of the section appears larger than the globe's section in that plane. The RCM, in the
middle of the wall, and the port openings (`port_opening`) lie in the plane and indicate by how much.
"""

import math
from collections.abc import Sequence
from functools import cached_property
from itertools import compress

import numpy as np
from msgspec import Struct

from haptigraph.errors import BadInput
from haptigraph.geometry import Vec, subtract, unit
from haptigraph.imaging import tilt_corrected
from haptigraph.lens import Lens
from haptigraph.messages import Image
from haptigraph.perception.anatomy.camera_tilt import find_camera_tilt
from haptigraph.perception.anatomy.edge import Edge
from haptigraph.perception.anatomy.expected import Expected
from haptigraph.perception.anatomy.lens_risk import lens_risk_px
from haptigraph.perception.anatomy.moving_shaft import find_rcms, median_image
from haptigraph.perception.anatomy.port_opening import (
    MAX_OPENINGS,
    MIN_SEPARATION_DEG,
    WHITE_GREY,
    PortOpening,
    find_port_openings,
)
from haptigraph.perception.anatomy.rcm import Rcm
from haptigraph.perception.anatomy.rim import Rim, find_rim
from haptigraph.perception.anatomy.tracked_rcm import tracked_rcm
from haptigraph.projection import ImageMap, LensMap, image_map
from haptigraph.registration.tilt import CameraTilt

__all__ = ["Anatomy", "FoundTrocar", "find_anatomy", "point_at"]

RETINA_HALF_DEG = 75.0
RETINA_STEP_DEG = 1.5
REFINE_DEG = 3.0  # rays within this angle of a contour point refine it
MIN_REFINE_RAYS = 6
MAX_REFINE_PX = 3.0
RIM_EXCESS_SD = 0.015  # prior of the rim's enlargement
RIM_HEIGHT_RATIO = 0.08  # prior of the rim's height above the section, relative to the radius
RCM_OFFSET_RATIO = 0.004  # of the radius: a trocar may be off the middle of the wall
OPENING_SD_PX = 0.7
MAX_WHITE_SHARE = 0.5  # of the area within a single edge


class FoundTrocar(Struct, frozen=True):
    """A trocar."""

    point_px: Vec
    """Middle of the wall, in the plane of the section."""
    angle_deg: float
    """From the top, positive to the image's right."""
    rcm: Rcm | None
    """RCM of an instrument that moved in it; None if only the port opening was detected."""
    angle_sd_deg: float | None = None
    """Standard deviation, unless there is an RCM."""
    is_designed: bool = False
    """Whether it was not found at all, and has its designed position."""


class Anatomy(Struct, frozen=True, eq=False, dict=True):
    """The anatomy found, in the frontal view where the camera is tilted."""

    reference_image: Image
    """Median of the images, as the camera took them."""
    tilt: CameraTilt | None
    """None if no tilt is measurable."""
    rim: Rim
    center_px: Vec
    """Centre of the globe's section."""
    radius_px: float
    contour_px: tuple[Vec, ...]
    """The retina, from the image's left over the bottom to its right."""
    measured_points: int
    """How many contour points were measured; the others are on the fitted curve."""
    trocars: tuple[FoundTrocar, ...]
    """Those in which an instrument moves come first."""
    rim_ratio: float
    """Apparent size of the rim relative to the section."""
    rim_uncertainty_px: float
    """Standard deviation of globe and retina due to that of `rim_ratio`, at the worst point."""
    rim_evidence: tuple[str, ...]
    """What `rim_ratio` was estimated from: "design", "needle", "port_openings" or nothing."""
    lens: Lens | None = None
    """The calibrated lens, if there is one."""
    lens_risk_px: float | None = None
    """Without one, the error that its distortion does not exceed with a probability of 95 %."""

    @cached_property
    def frontal_map(self) -> ImageMap | None:
        """From the image as stored to the frontal view; None if they are the same."""
        return image_map(self.lens, self.tilt.frontal_from_image if self.tilt else None)

    def image_px(self, frontal_px: Vec) -> Vec:
        """Map a point from the frontal view to the image as stored."""
        return self.frontal_map.inverse(frontal_px) if self.frontal_map else frontal_px

    def frontal_px(self, point_px: Vec) -> Vec:
        """Map a point from the image as stored to the frontal view."""
        return self.frontal_map(point_px) if self.frontal_map else point_px


def find_anatomy(
    images: Sequence[Image], *, expected: Expected | None = None, lens: Lens | None = None
) -> Anatomy:
    """Find globe, retina and trocars.

    Args:
        images: At least one, all of one size, from a camera at rest; best with a moving needle.
        expected: Where the design of the set-up has them: they are first searched there.
        lens: The camera's lens, if it was calibrated.

    Raises:
        BadInput: If there is no eye, or it is cut off or blurred.
    """
    reference = frontal = median_image(images)
    principal_px = (reference.shape[1] - 1) / 2, (reference.shape[0] - 1) / 2
    if lens is not None:
        frontal, principal_px = tilt_corrected(reference, LensMap(lens)), lens.principal_px
    rim = find_rim(frontal, expected)
    tilt = find_camera_tilt(rim, principal_px, expected, lens.ideal_focal_px if lens else None)
    if frontal_map := image_map(lens, tilt.frontal_from_image if tilt else None):
        images = [tilt_corrected(image, frontal_map) for image in images]
    if frontal_map and tilt:
        frontal = tilt_corrected(reference, frontal_map)
        rim = find_rim(frontal, expected)
    foot_px = foot_x, foot_y = tilt.foot_px if tilt else principal_px
    rough = find_rcms(images, frontal, rim) if len(images) > 1 else ()
    rcms = [rcm.combined_with(tracked_rcm(images, rim, rcm.point_px)) for rcm in rough]
    is_expected = expected and expected.is_near(rim.inner.center_px, rim.inner.radius_px)
    if not is_expected:  # its radius distinguishes the inner edge from the outer one
        _check_edge_is_inner(rim, rcms, frontal)
    port_openings = find_port_openings(frontal, rim.inner)
    if expected:
        are_ports = expected.ports_among([each.angle_deg for each in port_openings])
        port_openings = list(compress(port_openings, are_ports))
    excess, excess_sd, rim_evidence = _rim_excess(rim, rcms, port_openings, tilt, foot_px, expected)
    rim_ratio = 1 + excess

    def section(rim_px: Vec) -> Vec:
        return foot_x + (rim_px[0] - foot_x) / rim_ratio, foot_y + (rim_px[1] - foot_y) / rim_ratio

    middle_px = rim.inner.radius_px * (1 + expected.wall_ratio) / 2 if expected else rim.middle_px
    contour, measured_points = _contour(rim.inner)
    return Anatomy(
        reference_image=reference,
        tilt=tilt,
        rim=rim,
        center_px=section(rim.inner.center_px),
        radius_px=rim.inner.radius_px / rim_ratio,
        contour_px=tuple(section(point) for point in contour),
        measured_points=measured_points,
        trocars=_trocars(port_openings, rcms, section(rim.inner.center_px), middle_px / rim_ratio),
        rim_ratio=rim_ratio,
        rim_uncertainty_px=excess_sd
        * math.hypot(rim.inner.radius_px, *subtract(rim.inner.center_px, foot_px)),
        rim_evidence=rim_evidence,
        lens=lens,
        lens_risk_px=None if lens else lens_risk_px(rim, tilt, (reference.shape[1], reference.shape[0])),
    )


def _check_edge_is_inner(rim: Rim, rcms: Sequence[Rcm], frontal: Image) -> None:
    """Refuse a single edge that may be the wall's outer one; an RCM outside it proves that it is not."""
    if rim.outer is not None:
        return
    white = _white_share(rim, frontal)
    if white > MAX_WHITE_SHARE:
        raise BadInput(
            f"the eye is overexposed: {white:.0%} of it is white, and only one edge of its wall is visible; "
            "use less light or a shorter exposure to show the other"
        )
    distances_px = [math.dist(rcm.point_px, rim.inner.center_px) for rcm in rcms]
    if min(distances_px, default=0.0) <= rim.inner.radius_px:
        raise BadInput(
            "only one edge of the globe's wall is visible, and it may be the outer one; "
            "use more light, a sharper image or a clip with a moving needle"
        )


def _white_share(rim: Rim, frontal: Image) -> float:
    """Return the share of saturated pixels within the edge."""
    y, x = np.ogrid[: frontal.shape[0], : frontal.shape[1]]
    (center_x, center_y), radius_px = rim.inner.center_px, rim.inner.radius_px
    inside = frontal[(x - center_x) ** 2 + (y - center_y) ** 2 < radius_px**2]
    darkest = inside if inside.ndim == 1 else inside.min(axis=1)
    return float(np.mean(darkest >= WHITE_GREY))


def _rim_excess(
    rim: Rim,
    rcms: Sequence[Rcm],
    port_openings: Sequence[PortOpening],
    tilt: CameraTilt | None,
    foot_px: Vec,
    expected: Expected | None,
) -> tuple[float, float, tuple[str, ...]]:
    """Estimate how much larger than the section the rim appears: (share, its standard deviation, evidence).

    Inverse-variance-weighted mean of a prior, the needle's RCM and the port openings. Never less than 0,
    because the wall occludes the needle.
    """
    center, radius_px = rim.inner.center_px, rim.inner.radius_px
    prior, prior_sd = 0.0, RIM_EXCESS_SD
    if expected:
        prior, prior_sd = expected.rim_ratio - 1, expected.rim_ratio_sd
    elif tilt:
        prior_sd = min(RIM_EXCESS_SD, RIM_HEIGHT_RATIO * radius_px / tilt.focal_px)
    estimates: list[tuple[float, float]] = [(prior, prior_sd)]
    evidence = ["design"] if expected else []

    def estimate(point: Vec, circle_px: float, sd_px: float) -> tuple[float, float]:
        outwards, lever = unit(subtract(point, center)), subtract(point, foot_px)
        lever_px = max(abs(lever[0] * outwards[0] + lever[1] * outwards[1]), 1.0)
        return _excess_through(point, circle_px, center, foot_px), sd_px / lever_px

    for rcm in rcms if rim.outer is not None else ():
        sd_px = math.hypot(rcm.radial_sd_px, RCM_OFFSET_RATIO * radius_px)
        estimates.append(estimate(rcm.point_px, rim.middle_px, sd_px))
        evidence += ["needle"] if estimates[-1][1] < prior_sd and "needle" not in evidence else []
    by_opening = [
        estimate(point_at(center, radius_px - each.inside_px, each.angle_deg), radius_px, OPENING_SD_PX)
        for each in port_openings
        if each.inside_px is not None
    ]
    # A reflection or another instrument may look like one port opening, but not like two that agree.
    consistent = [
        one
        for number, one in enumerate(by_opening)
        if any(
            abs(one[0] - other[0]) < 2 * max(one[1], other[1])
            for other in by_opening[:number] + by_opening[number + 1 :]
        )
    ]
    estimates += consistent
    evidence += ["port_openings"] if consistent else []
    weights = [1 / sd**2 for _, sd in estimates]
    excess = sum(weight * share for weight, (share, _) in zip(weights, estimates, strict=True)) / sum(weights)
    low = max(prior - 3 * prior_sd, 0.0)
    return min(max(excess, low), prior + 3 * prior_sd), 1 / math.sqrt(sum(weights)), tuple(evidence)


def _excess_through(point_px: Vec, radius_px: float, center_px: Vec, foot_px: Vec) -> float:
    """Return the share by which a circle must shrink towards `foot_px` to pass through a point."""
    (ax, ay), (bx, by) = ((x - foot_px[0], y - foot_px[1]) for x, y in (point_px, center_px))
    square, along = ax * ax + ay * ay, ax * bx + ay * by
    inner = along * along - square * (bx * bx + by * by - radius_px * radius_px)
    root = math.sqrt(max(inner, 0.0))
    return min(((along + sign * root) / square - 1 for sign in (1, -1)), key=abs)


def point_at(center_px: Vec, radius_px: float, angle_deg: float) -> Vec:
    """Return the point on a circle at an angle from the top."""
    angle = math.radians(angle_deg)
    return center_px[0] + radius_px * math.sin(angle), center_px[1] - radius_px * math.cos(angle)


def _contour(edge: Edge) -> tuple[list[Vec], int]:
    """Return the lower part of the inner edge, refined by the rays, and the number of refined points."""
    steps = round(2 * RETINA_HALF_DEG / RETINA_STEP_DEG)
    angles = np.radians(np.linspace(-RETINA_HALF_DEG, RETINA_HALF_DEG, steps + 1))
    radii = edge.radii_px(angles)
    separation = (edge.angles[None, :] - angles[:, None] + math.pi) % (2 * math.pi) - math.pi
    measured_points = 0
    for row, near in enumerate(np.abs(separation) < math.radians(REFINE_DEG)):
        if near.sum() >= MIN_REFINE_RAYS:
            measured_points += 1
            radii[row] += np.clip(np.median(edge.offsets_px[near]), -MAX_REFINE_PX, MAX_REFINE_PX)
    x = edge.center_px[0] + radii * np.sin(angles)
    y = edge.center_px[1] + radii * np.cos(angles)
    return [(float(a), float(b)) for a, b in zip(x, y, strict=True)], measured_points


def _trocars(
    port_openings: Sequence[PortOpening], rcms: Sequence[Rcm], center_px: Vec, middle_px: float
) -> tuple[FoundTrocar, ...]:
    """Return the trocars with an RCM, then the other port openings, strongest contrast first."""
    found: list[FoundTrocar] = []
    for rcm in rcms:
        right, down = rcm.point_px[0] - center_px[0], rcm.point_px[1] - center_px[1]
        found.append(FoundTrocar(rcm.point_px, math.degrees(math.atan2(right, -down)), rcm))
    for port_opening in port_openings:
        if all(abs(other.angle_deg - port_opening.angle_deg) > MIN_SEPARATION_DEG for other in found):
            point_px = point_at(center_px, middle_px, port_opening.angle_deg)
            found.append(FoundTrocar(point_px, port_opening.angle_deg, None, port_opening.angle_sd_deg))
    return tuple(found[:MAX_OPENINGS])
