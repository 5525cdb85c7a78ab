"""Find the remote centre of motion (RCM) of a moving needle: all its shaft lines meet there [px].

Returns a second RCM if something else that moves may be the needle. Changes of illumination do not count as
motion.
"""

import math
from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.imaging import Floats, grey_of, peak_offset
from haptigraph.messages import Image
from haptigraph.perception.anatomy.illumination import equalize_illumination
from haptigraph.perception.anatomy.rcm import Rcm, ShaftLine, fit_rcm
from haptigraph.perception.anatomy.rim import TYPICAL_WALL_MIDDLE, Rim

__all__ = ["ILLUMINATION_RATIO", "find_rcms", "median_image", "moving_mask"]

MIN_CHANGE_GREY = 14.0
MAX_POINTS = 4000
TRIALS = 150
# Ratios are relative to the globe's radius.
MIN_LENGTH_RATIO = 0.15  # visible length of a shaft
MAX_WIDTH_RATIO = 0.07  # of a shaft
STATION_RATIO = 0.02  # between stations, where the shaft's centre is measured
EDGE_STEP_PX = 0.25
MIN_EDGE_SHARE = 0.4  # of the steepest gradient on the same side of the shaft
MAX_SD_RATIO = 0.3  # of both standard deviations: the RCM of only what moved is much more certain
MIN_SEPARATION_RATIO = 0.1  # between two RCMs
MIN_NEW_SHARE, NEW_SAMPLES = 0.3, 40  # of a moving shaft, share that differs from the reference; samples
MIN_RIVAL_LINES = 0.5  # share of the needle's lines
MAX_RIVAL_RESIDUAL = 0.0013  # ratio; of the lines of a second needle
ILLUMINATION_RATIO = 0.7  # width over which illumination changes uniformly


def median_image(images: Sequence[Image]) -> Image:
    """Return the median of images at every pixel: the scene without what moves."""
    rows = [
        np.median(np.stack([image[row] for image in images]), axis=0) for row in range(images[0].shape[0])
    ]
    return np.asarray(np.stack(rows), np.uint8)


def find_rcms(images: Sequence[Image], reference: Image, rim: Rim) -> tuple[Rcm, ...]:
    """Find the RCM of a moving needle, in the wall's upper half.

    Args:
        images: Images of one clip, at different times.
        reference: Their median.
        rim: The globe's wall.

    Returns:
        The RCM. Empty if no needle moves, or if the lines do not belong to one needle. Two if something else
        that moves may be the needle.
    """
    images = equalize_illumination(images, reference, ILLUMINATION_RATIO * rim.inner.radius_px)
    visible = _visible(rim, images[0].shape[1], images[0].shape[0]) & moving_mask(images, rim)
    greys, reference_grey = [grey_of(image) for image in images], grey_of(reference)
    contrasts = [_contrast(grey, _surroundings(grey, rim)) for grey in greys]
    changed = [visible & (_contrast(grey, reference_grey) > MIN_CHANGE_GREY) for grey in greys]

    def shafts_in(masks: Iterable[NDArray[np.bool_]]) -> list[ShaftLine | None]:
        return [_shaft(*each, rim) for each in zip(greys, contrasts, masks, strict=True)]

    lines, new_lines = shafts_in([visible] * len(greys)), shafts_in(changed)
    rcm, new_rcm = fit_rcm(lines, rim), fit_rcm(new_lines, rim)
    if new_rcm is None:
        return (rcm,) if rcm else ()
    # A static structure, such as a vessel, may look like a shaft or blend with the part that hardly moves.
    is_static = rcm and _are_apart(rcm, new_rcm, rim) and _new_share(lines, changed) < MIN_NEW_SHARE
    if rcm is None or is_static or new_rcm.radial_sd_px < MAX_SD_RATIO * rcm.radial_sd_px:
        rcm = new_rcm
    second = fit_rcm(shafts_in(_off_shaft(*each, rim) for each in zip(changed, new_lines, strict=True)), rim)
    others = [each for each in (new_rcm, second) if each and _is_rival(each, rcm, rim)]
    return rcm, *others[:1]


def _is_rival(other: Rcm, rcm: Rcm, rim: Rim) -> bool:
    """Return whether another RCM may be the needle's; lines of bubbles and debris do not meet in a point."""
    is_straight = other.residual_px <= MAX_RIVAL_RESIDUAL * rim.inner.radius_px
    return is_straight and other.lines >= MIN_RIVAL_LINES * rcm.lines and _are_apart(other, rcm, rim)


def _are_apart(one: Rcm, other: Rcm, rim: Rim) -> bool:
    return math.dist(one.point_px, other.point_px) > MIN_SEPARATION_RATIO * rim.inner.radius_px


def _off_shaft(mask: NDArray[np.bool_], line: ShaftLine | None, rim: Rim) -> NDArray[np.bool_]:
    """Remove a shaft from a mask, (h, w)."""
    if line is None:
        return mask
    y, x = np.ogrid[: mask.shape[0], : mask.shape[1]]
    (point_x, point_y), (normal_x, normal_y) = line.point_px, line.normal
    distance_px = np.abs((x - point_x) * normal_x + (y - point_y) * normal_y)
    return np.asarray(mask & (distance_px > MAX_WIDTH_RATIO * rim.inner.radius_px))


def _new_share(lines: Sequence[ShaftLine | None], changed: Sequence[NDArray[np.bool_]]) -> float:
    """Return the median over images of the share of a shaft that differs from the reference image."""
    shares = []
    for line, mask in zip(lines, changed, strict=True):
        if line is not None:
            along = np.linspace(-line.length_px / 2, line.length_px / 2, NEW_SAMPLES)[:, None]
            x, y = np.rint(line.point_px + along * line.along).astype(int).T
            height, width = mask.shape
            shares.append(mask[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)].mean())
    return float(np.median(shares))


def _surroundings(grey: Image, rim: Rim) -> Image:
    """Return the image without thin structures such as a shaft, (h, w)."""
    size_px = 2 * round(1.5 * MAX_WIDTH_RATIO * rim.inner.radius_px) + 1
    return np.asarray(cv2.medianBlur(grey, size_px), np.uint8)


def _contrast(grey: Image, other: Image) -> Image:
    """Return the smoothed absolute difference of two grey images, (h, w)."""
    return np.asarray(cv2.blur(cv2.absdiff(grey, other), (3, 3)), np.uint8)


def moving_mask(images: Sequence[Image], rim: Rim) -> NDArray[np.bool_]:
    """Return a dilated mask of where images differ, (h, w)."""
    brightest = darkest = cv2.blur(images[0], (3, 3))
    for image in images[1:]:
        smooth = cv2.blur(image, (3, 3))
        brightest, darkest = np.maximum(brightest, smooth), np.minimum(darkest, smooth)
    change = cv2.subtract(brightest, darkest)
    change = change if change.ndim == 2 else change.max(axis=2)
    noise = float(np.median(change))
    moved = (change > max(MIN_CHANGE_GREY, 2.5 * noise)).astype(np.uint8)
    side = 2 * round(MAX_WIDTH_RATIO * rim.inner.radius_px) + 1
    return np.asarray(cv2.dilate(cv2.erode(moved, np.ones((3, 3))), np.ones((side, side)))) > 0


def _visible(rim: Rim, width_px: int, height_px: int) -> NDArray[np.bool_]:
    """Return where a needle is neither occluded by the wall nor cut off by the image border, (h, w)."""
    y, x = np.ogrid[:height_px, :width_px]
    inner, outer = rim.inner, rim.outer or rim.inner
    distance = np.hypot(x - inner.center_px[0], y - inner.center_px[1])
    border = 1.5 * MAX_WIDTH_RATIO * inner.radius_px
    whole = (x > border) & (x < width_px - border) & (y > border)
    outside = (distance > outer.radius_px * 1.02) & (y < inner.center_px[1] - 0.2 * inner.radius_px)
    return np.asarray(((distance < inner.radius_px * 0.97) | outside) & whole)


def _shaft(grey: Image, contrast: Image, mask: NDArray[np.bool_], rim: Rim) -> ShaftLine | None:
    """Fit the thin straight structure that stands out from its surroundings.

    Args:
        grey: The image, (h, w).
        contrast: Its contrast with the surroundings, (h, w).
        mask: Where to search, (h, w).
        rim: The globe's wall.
    """
    radius_px = rim.inner.radius_px
    points = _points(contrast, mask, MIN_CHANGE_GREY)
    if len(points) < 50:
        return None
    line = _ransac_line(points[:: len(points) // MAX_POINTS + 1], MAX_WIDTH_RATIO * radius_px / 3, rim)
    if line is None:
        return None
    across = np.abs((points - line.point_px) @ line.normal)
    x, y = points[across < MAX_WIDTH_RATIO * radius_px / 4].astype(int).T
    points = _points(contrast, mask, max(MIN_CHANGE_GREY, 0.5 * float(np.quantile(contrast[y, x], 0.7))))
    narrow_px = 0.8 * MAX_WIDTH_RATIO * radius_px
    for width_px in (MAX_WIDTH_RATIO * radius_px, narrow_px, narrow_px):
        line = _center_line(points, line, width_px, radius_px) if line else None
    if line is None or not _enters_globe(points, line, rim):
        return None
    return _between_edges(grey, points, line, radius_px)


def _enters_globe(points: Floats, line: ShaftLine, rim: Rim) -> bool:
    """Return whether enough of the shaft is visible inside the globe; outside, its line is extrapolated."""
    inside = np.hypot(*(points - rim.inner.center_px).T) < rim.inner.radius_px
    relative = points[inside] - line.point_px
    near = np.abs(relative @ line.normal) < MAX_WIDTH_RATIO * rim.inner.radius_px / 2
    stations = np.unique(np.floor(relative[near] @ line.along / (STATION_RATIO * rim.inner.radius_px)))
    return bool(len(stations) * STATION_RATIO >= MIN_LENGTH_RATIO)


def _points(contrast: Image, mask: NDArray[np.bool_], min_grey: float) -> Floats:
    """Return the pixels with enough contrast, (n, 2)."""
    y, x = np.nonzero((contrast > min_grey) & mask)
    return np.stack([x, y], axis=1).astype(float)


def _ransac_line(points: Floats, width_px: float, rim: Rim) -> ShaftLine | None:
    """Fit a line that crosses the upper wall by RANSAC."""
    rng = np.random.default_rng(0)
    first, second = points[rng.integers(0, len(points), (2, TRIALS))]
    away = second - first
    length = np.hypot(*away.T)
    is_kept = length > 0.3 * MIN_LENGTH_RATIO * rim.inner.radius_px
    first, along = first[is_kept], away[is_kept] / length[is_kept][:, None]
    up = _crosses_upper_wall(first, along, rim)
    first, along = first[up], along[up]
    if not len(first):
        return None
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    distance = np.abs(points @ normal.T - np.sum(first * normal, axis=1))
    best = int((distance < width_px).sum(axis=0).argmax())
    return ShaftLine(first[best], along[best], 0.0)


def _crosses_upper_wall(points: Floats, along: Floats, rim: Rim) -> NDArray[np.bool_]:
    """Return which lines enter the globe from above, (n,)."""
    center = np.array(rim.inner.center_px)
    from_center = points - center
    middle = np.sum(from_center * along, axis=1)
    square = np.sum(from_center**2, axis=1) - middle**2  # of the line's distance from the centre
    half = np.sqrt(np.maximum((TYPICAL_WALL_MIDDLE * rim.inner.radius_px) ** 2 - square, 0))
    upwards = along * -np.sign(along[:, 1:2])
    middle = np.sum(from_center * upwards, axis=1)
    entry = from_center + upwards * (half - middle)[:, None]
    is_central = square < (0.95 * rim.inner.radius_px) ** 2
    return np.asarray(is_central & (entry[:, 1] < -0.2 * rim.inner.radius_px))


def _center_line(points: Floats, line: ShaftLine, width_px: float, radius_px: float) -> ShaftLine | None:
    """Fit a line to the mean of the points at every station."""
    relative = points - line.point_px
    along, across = relative @ line.along, relative @ line.normal
    near = np.abs(across) < width_px
    along, across = along[near], across[near]
    if not len(along):
        return None
    station = np.floor((along - along.min()) / (STATION_RATIO * radius_px)).astype(int)
    count = np.bincount(station)
    full = count >= 0.4 * np.median(count[count > 0])
    if full.sum() * STATION_RATIO < MIN_LENGTH_RATIO:
        return None
    along, across = (np.bincount(station, v)[full] / count[full] for v in (along, across))
    return _fit(line, along, across, float(full.sum()) * STATION_RATIO * radius_px)


def _between_edges(grey: Image, points: Floats, line: ShaftLine, radius_px: float) -> ShaftLine | None:
    """Fit the line midway between the shaft's two edges, each at the steepest gradient."""
    relative = points - line.point_px
    near = np.abs(relative @ line.normal) < MAX_WIDTH_RATIO * radius_px / 2
    stations, count = np.unique(np.rint(relative[near] @ line.along / 2), return_counts=True)
    along = 2 * stations[count >= 3]
    away = np.arange(0.0, MAX_WIDTH_RATIO * radius_px, EDGE_STEP_PX)
    smooth = np.asarray(cv2.GaussianBlur(grey, (0, 0), 1.0)).astype(np.float32)
    edges = []
    for side in (-1, 1):
        points = line.point_px + along[:, None, None] * line.along + side * away[:, None] * line.normal
        x, y = points.astype(np.float32).transpose(2, 0, 1)
        profile = cv2.remap(smooth, x, y, cv2.INTER_LINEAR)
        gradient = np.abs(np.gradient(profile, axis=1))
        best = _outermost_peak(gradient)
        before, at, after = (gradient[np.arange(len(along)), best + d] for d in (-1, 0, 1))
        edges.append(side * (away[best] + peak_offset(before, at, after) * EDGE_STEP_PX))
    width = edges[1] - edges[0]
    # The shaft may taper: compare each width with those of neighbouring stations.
    typical = np.array([np.median(width[max(i - 15, 0) : i + 16]) for i in range(len(width))])
    is_kept = np.abs(width - typical) < np.maximum(0.15 * typical, 1.0)
    if is_kept.sum() * 2 < MIN_LENGTH_RATIO * radius_px:
        return None
    middle = (edges[0] + edges[1]) / 2
    return _fit(line, along[is_kept], middle[is_kept], float(is_kept.sum()) * 2)


def _outermost_peak(gradient: Floats) -> NDArray[np.int_]:
    """Return each row's last strong peak: a bright shaft has steep gradients between its edges, too."""
    inner = gradient[:, 1:-1]
    is_peak = (inner >= gradient[:, :-2]) & (inner >= gradient[:, 2:])
    is_peak &= inner >= MIN_EDGE_SHARE * gradient.max(axis=1, keepdims=True)
    last = is_peak.shape[1] - np.argmax(is_peak[:, ::-1], axis=1)
    return np.asarray(np.where(is_peak.any(axis=1), last, 1))


def _fit(line: ShaftLine, along: Floats, across: Floats, length_px: float) -> ShaftLine:
    """Fit a line robustly (iteratively reweighted) to points given in the frame of another line."""
    weight = np.ones(len(along))
    slope = offset = 0.0
    for _ in range(8):
        slope, offset = np.polyfit(along, across, 1, w=weight)
        residual = np.abs(across - slope * along - offset)
        weight = 1 / np.maximum(residual / max(float(np.median(residual)) * 1.5, 0.05), 1)
    direction = line.along + slope * line.normal
    point = line.point_px + offset * line.normal + float(along.mean()) * direction
    return ShaftLine(point, direction / np.hypot(*direction), length_px)
