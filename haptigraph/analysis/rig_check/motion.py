"""Estimate how the eye has moved in the picture since it was registered, with its uncertainty.

With a reference image, details of eye and surroundings are followed from it into the picture; without one,
the rim is compared with the registered circle, and the port openings with the registered trocars.
"""

import math
from typing import NamedTuple

import cv2
import numpy as np
from msgspec import Struct

from haptigraph.analysis.rig_check.view import View, wrapped_deg
from haptigraph.geometry import Vec
from haptigraph.imaging import Floats, grey_of
from haptigraph.messages import Image
from haptigraph.perception.anatomy.edge import Edge
from haptigraph.perception.anatomy.port_opening import polar_samples
from haptigraph.perception.anatomy.rim import Rim

__all__ = ["Motion", "TurnedPort", "by_reference", "by_rim", "turned_ports"]

POINTS, QUALITY, SPACING_PX = 400, 0.01, 8
MIN_POINTS = 25
MIN_INLIER_SHARE = 0.35
INLIER_PX = 1.5
ANGLES_DEG = np.arange(0.0, 360.0, 0.5)  # from the top
RADII_RATIO, RADII = (0.3, 1.5), 60  # of the rim's radius: what is compared to find a rotation
RETURN_PX = 0.7  # between a point and where it comes back to
CORRELATED_POINTS = 4.0  # neighbouring details have errors in common
PORT_MATCH_DEG = 8.0
RIM_SD_PX, MIN_CENTER_SD_PX = 0.3, 0.02  # of the centre of a rim and of one edge, at least
QUARTERS = 4  # of an edge: a shade beside it that is taken for it is no longer
PORT_SD_DEG, OCCLUDED_SD_DEG = 1.2, 3.0
"""Standard deviations of the angle of a port opening, and of one that a shaft occludes."""
SHAFT_RATIOS, SHAFT_DEG = (0.84, 0.9), 15.0  # of the rim's radius, and on either side of a trocar
MIN_SHAFT_GREY = 6.0  # of a shaft before the bowl there


class Motion(Struct, frozen=True):
    """The motion of the eye in the picture since its registration."""

    shift_px: float
    """Of the globe's centre."""
    shift_sd_px: float
    scale: float
    """How much larger the eye appears."""
    scale_sd: float
    turn_deg: float | None
    """Clockwise rotation; None: not observable."""
    turn_sd_deg: float = math.inf
    evidence: str = ""
    """What it was estimated from."""


class TurnedPort(NamedTuple):
    """How far a registered trocar's opening is turned, clockwise."""

    turn_deg: float
    sd_deg: float


def by_reference(view: View) -> Motion | None:
    """Follow details from the reference image into the picture; None if that cannot be done."""
    background, rim, reference_rim = view.registration.background, view.rim, view.reference_rim
    if background is None or rim is None or reference_rim is None:
        return None
    start = _alignment(view, background.image, reference_rim.inner)
    height, width = view.image.shape[:2]
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    aligned = cv2.warpAffine(view.image, start, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)
    pairs = _followed(grey_of(background.image), grey_of(np.asarray(aligned, np.uint8)), background.is_known)
    if pairs is None:
        return None
    before, after = pairs
    fitted = _similarity(before, after @ start[:, :2].T + start[:, 2])
    if fitted is None:
        return None
    (a, b, x, y), covariance = fitted
    center_x, center_y = view.center_px
    shift = a * center_x - b * center_y + x - center_x, b * center_x + a * center_y + y - center_y
    at_center = np.array([[center_x, -center_y, 1, 0], [center_y, center_x, 0, 1]])
    shift_sd = math.sqrt(float(np.trace(at_center @ covariance @ at_center.T)))
    return Motion(
        math.hypot(*shift),
        shift_sd,
        math.hypot(a, b),
        math.sqrt(float(covariance[0, 0])),
        math.degrees(math.atan2(b, a)),
        math.degrees(math.sqrt(float(covariance[1, 1]))),
        "the reference image",
    )


def _alignment(view: View, reference: Image, rim: Edge) -> Floats:
    """Return the similarity from the reference image's rim to the one found, turned to fit best, (2, 3)."""
    radii = np.linspace(*RADII_RATIO, RADII)
    before = polar_samples(grey_of(reference), rim.center_px, ANGLES_DEG, radii * rim.radius_px)
    after = polar_samples(grey_of(view.image), view.found_center_px, ANGLES_DEG, radii * view.found_radius_px)
    spectra = (np.fft.rfft(each - each.mean(axis=0), axis=0) for each in (before, after))
    likeness = np.fft.irfft(next(spectra).conj() * next(spectra), axis=0).sum(axis=1)
    turn = math.radians(float(ANGLES_DEG[int(likeness.argmax())]))
    scale = view.found_radius_px / rim.radius_px
    a, b, (rx, ry), (fx, fy) = (
        scale * math.cos(turn),
        scale * math.sin(turn),
        rim.center_px,
        view.found_center_px,
    )
    return np.array([[a, -b, fx - a * rx + b * ry], [b, a, fy - b * rx - a * ry]])


def _followed(before: "np.ndarray", after: "np.ndarray", known: "np.ndarray") -> tuple[Floats, Floats] | None:
    """Return details that are in both images, (n, 2) each."""
    mask = cv2.erode(known.astype(np.uint8) * 255, np.ones((15, 15)))
    points = cv2.goodFeaturesToTrack(before, POINTS, QUALITY, SPACING_PX, mask=mask)
    if points is None or len(points) < MIN_POINTS:
        return None
    found, is_found, _ = cv2.calcOpticalFlowPyrLK(before, after, points, points.copy(), None, None, (25, 25))
    back, is_back, _ = cv2.calcOpticalFlowPyrLK(after, before, found, points.copy(), None, None, (25, 25))
    is_good = (is_found.ravel() > 0) & (is_back.ravel() > 0)
    is_good &= np.linalg.norm((back - points).reshape(-1, 2), axis=1) < RETURN_PX
    if is_good.sum() < MIN_POINTS:
        return None
    return points.reshape(-1, 2)[is_good].astype(np.float64), found.reshape(-1, 2)[is_good].astype(np.float64)


def _similarity(before: Floats, after: Floats) -> tuple[Floats, Floats] | None:
    """Fit x' = a x - b y + c, y' = b x + a y + d robustly; return (a, b, c, d) and their covariance."""
    _, is_inlier = cv2.estimateAffinePartial2D(
        before, after, method=cv2.RANSAC, ransacReprojThreshold=INLIER_PX
    )
    if is_inlier is None or is_inlier.sum() < max(MIN_POINTS, MIN_INLIER_SHARE * len(before)):
        return None
    chosen = is_inlier.ravel() > 0
    (x, y), target = before[chosen].T, after[chosen]
    one, zero = np.ones_like(x), np.zeros_like(x)
    design = np.vstack([np.stack([x, -y, one, zero], axis=1), np.stack([y, x, zero, one], axis=1)])
    measured = np.concatenate([target[:, 0], target[:, 1]])
    values = np.linalg.lstsq(design, measured, rcond=None)[0]
    variance = float(np.mean((design @ values - measured) ** 2)) * CORRELATED_POINTS
    return values, np.linalg.inv(design.T @ design) * variance


def by_rim(view: View) -> Motion | None:
    """Compare the rim with the registered circle, or the reference image's rim; None if there is no rim."""
    if view.rim is None:
        return None
    center_px, sd_px = _center(view.rim)
    registered_px, radius_px = view.center_px, view.radius_px
    scale_sd = _sds(view.rim.inner).radius_px / radius_px
    if (reference := view.reference_rim) is not None:
        (registered_px, reference_sd_px), radius_px = _center(reference), reference.inner.radius_px
        sd_px = math.hypot(sd_px, reference_sd_px)
        scale_sd = math.hypot(scale_sd, _sds(reference.inner).radius_px / radius_px)
    turned = turned_ports(view)
    precisions = np.array([port.sd_deg**-2 for port in turned])
    return Motion(
        math.dist(center_px, registered_px),
        sd_px,
        view.rim.inner.radius_px / radius_px,
        scale_sd,
        float(np.average([port.turn_deg for port in turned], weights=precisions)) if turned else None,
        float(precisions.sum()) ** -0.5 if turned else math.inf,
        "the rim and the port openings" if turned else "the rim",
    )


def _center(rim: Rim) -> tuple[Vec, float]:
    """Return the centre of the wall, and its standard deviation: the weighted mean of its edges' centres.

    What they differ by counts, too.
    """
    edges = [edge for edge in (rim.inner, rim.outer) if edge is not None]
    centers = np.array([edge.center_px for edge in edges])
    weights = np.array([1 / max(_sds(edge).center_px, MIN_CENTER_SD_PX) ** 2 for edge in edges])
    x, y = weights @ centers / weights.sum()
    squared = weights @ ((centers - [x, y]) ** 2).sum(axis=1) / weights.sum()
    return (float(x), float(y)), max(RIM_SD_PX, float(weights.sum()) ** -0.5, math.sqrt(float(squared)))


class _CircleSds(NamedTuple):
    """Standard deviations."""

    radius_px: float
    center_px: float


def _sds(edge: Edge) -> _CircleSds:
    """Return the standard deviations of an edge's circle: by how it changes without a quarter of the edge.

    An edge with little contrast may be taken for a shade beside it, and all its points there err alike.
    """
    turns = [one(order * edge.angles) for order in (1, 2) for one in (np.cos, np.sin)]
    design = np.column_stack([np.ones_like(edge.angles), *turns])
    quarter = (edge.angles / (2 * math.pi) * QUARTERS).astype(int) % QUARTERS
    others = [quarter != number for number in np.unique(quarter)]
    if len(others) < QUARTERS - 1:
        return _CircleSds(edge.radius_px, edge.radius_px)
    circles = [np.linalg.lstsq(design[one], edge.offsets_px[one], rcond=None)[0][:3] for one in others]
    radius, *center = np.sqrt((len(others) - 1) * np.var(circles, axis=0)).tolist()
    return _CircleSds(radius, math.hypot(*center))


def turned_ports(view: View) -> list[TurnedPort]:
    """Return how far the openings of the registered trocars are turned; empty if not all are visible."""
    turned = []
    for registered_deg in view.trocars_deg:
        off = [wrapped_deg(found_deg - registered_deg) for found_deg in view.ports_deg]
        nearest = min(off, key=abs, default=180.0)
        if abs(nearest) > PORT_MATCH_DEG:
            return []
        turned.append(
            TurnedPort(nearest, OCCLUDED_SD_DEG if _is_occluded(view, registered_deg) else PORT_SD_DEG)
        )
    return turned if len(turned) > 1 else []


def _is_occluded(view: View, trocar_deg: float) -> bool:
    """Return whether a shaft is before the bowl, inwards of a trocar: it hides where the opening ends."""
    off_deg = np.linspace(-SHAFT_DEG, SHAFT_DEG, 61)
    radii_px = np.linspace(*SHAFT_RATIOS, 7) * view.found_radius_px
    tone = view.samples_at_deg(trocar_deg + off_deg, radii_px).mean(axis=1)
    shading = np.column_stack([np.ones_like(off_deg), off_deg])
    contrast = tone - shading @ np.linalg.lstsq(shading, tone, rcond=None)[0]
    return bool(np.sqrt((contrast**2).mean(axis=1)).max() > MIN_SHAFT_GREY)
