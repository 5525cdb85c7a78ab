"""Find a needle that moves, and with it the trocar: all its shaft lines meet where it pivots [px].

Images of one clip in, their still picture and the pivot out; two, if something else moves that looks like a
needle. Light that changes does not count as movement. Knows nothing of retina or millimetres.
"""

import math
from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from haptigraph.imaging import Floats, grey_of, top_shift
from haptigraph.messages import Image
from haptigraph.perception.anatomy.illumination import evenly_lit
from haptigraph.perception.anatomy.rcm import Rcm, ShaftLine, meeting
from haptigraph.perception.anatomy.rim import Rim

__all__ = ["find_rcms", "still_picture"]

LEAST_CHANGE_GREY = 14.0
MOST_POINTS = 4000
TRIALS = 150
SHORTEST = 0.15  # of the globe's radius, that a shaft must be seen
LINE_WIDTH = 0.07  # of the globe's radius, that a shaft is thick at most
STATION = 0.02  # of the globe's radius, between places where the shaft's middle is measured
EDGE_STEP_PX = 0.25
CLEAR_EDGE = 0.4  # of the steepest place on the same side of the shaft
SURER = 0.3  # share of the doubt, if what is always there is left out
APART = 0.1  # of the globe's radius, between two pivots
OLD_SHARE, STATIONS = 0.3, 40  # that is new of what was always there; where that is looked up
OFTEN, TURNS = 0.5, 0.0013  # of the images in which a needle is seen; of the globe's radius, off its pivot
LIGHT = 0.7  # of the globe's radius, over which light changes alike


def still_picture(images: Sequence[Image]) -> Image:
    """Return what most images show at every pixel."""
    rows = [
        np.median(np.stack([image[row] for image in images]), axis=0) for row in range(images[0].shape[0])
    ]
    return np.asarray(np.stack(rows), np.uint8)


def find_rcms(images: Sequence[Image], still: Image, rim: Rim) -> tuple[Rcm, ...]:
    """Find where the shaft lines of a moving needle meet, in the wall's upper half.

    Args:
        images: Of one clip, at different times.
        still: What most of them show.
        rim: Where the wall is.

    Returns:
        Its pivot; nothing if no needle moves, or lines of several things were taken for its shaft; a second
        one if what moves elsewhere may be the needle as well.
    """
    images = evenly_lit(images, still, LIGHT * rim.inner.radius_px)
    visible = _visible(rim, images[0].shape[1], images[0].shape[0]) & _moving(images, rim)
    greys, still_grey = [grey_of(image) for image in images], grey_of(still)
    sizes = [_stands_out(grey, _around(grey, rim)) for grey in greys]
    where_new = [visible & (_stands_out(grey, still_grey) > LEAST_CHANGE_GREY) for grey in greys]

    def shafts_in(places: Iterable[NDArray[np.bool_]]) -> list[ShaftLine | None]:
        return [_shaft(*seen, rim) for seen in zip(greys, sizes, places, strict=True)]

    lines, new_lines = shafts_in([visible] * len(greys)), shafts_in(where_new)
    rcm, of_new = meeting(lines, rim), meeting(new_lines, rim)
    if of_new is None:
        return (rcm,) if rcm else ()
    # What is always there may be taken for a shaft, as a vessel is; or be the part of it that hardly moves.
    is_old = rcm and _are_apart(rcm, of_new, rim) and _new_share(lines, where_new) < OLD_SHARE
    if rcm is None or is_old or of_new.radial_sd_px < SURER * rcm.radial_sd_px:
        rcm = of_new
    beside = meeting(shafts_in(_beside(*each, rim) for each in zip(where_new, new_lines, strict=True)), rim)
    others = [each for each in (of_new, beside) if each and _is_rival(each, rcm, rim)]
    return rcm, *others[:1]


def _is_rival(other: Rcm, rcm: Rcm, rim: Rim) -> bool:
    """Tell whether what moves elsewhere may be the needle: bubbles and debris do not turn about one place."""
    is_straight = other.residual_px <= TURNS * rim.inner.radius_px
    return is_straight and other.lines >= OFTEN * rcm.lines and _are_apart(other, rcm, rim)


def _are_apart(one: Rcm, other: Rcm, rim: Rim) -> bool:
    return math.dist(one.point_px, other.point_px) > APART * rim.inner.radius_px


def _beside(places: NDArray[np.bool_], line: ShaftLine | None, rim: Rim) -> NDArray[np.bool_]:
    """Return those of some places that are not on a shaft, (h, w)."""
    if line is None:
        return places
    y, x = np.ogrid[: places.shape[0], : places.shape[1]]
    (at_x, at_y), (across_x, across_y) = line.point_px, line.normal
    off_px = np.abs((x - at_x) * across_x + (y - at_y) * across_y)
    return np.asarray(places & (off_px > LINE_WIDTH * rim.inner.radius_px))


def _new_share(lines: Sequence[ShaftLine | None], where_new: Sequence[NDArray[np.bool_]]) -> float:
    """Return how much of shafts, one or none for every image, was not always there: a median."""
    shares = []
    for line, is_new in zip(lines, where_new, strict=True):
        if line is not None:
            along = np.linspace(-line.length_px / 2, line.length_px / 2, STATIONS)[:, None]
            x, y = np.rint(line.point_px + along * line.along).astype(int).T
            height, width = is_new.shape
            shares.append(is_new[np.clip(y, 0, height - 1), np.clip(x, 0, width - 1)].mean())
    return float(np.median(shares))


def _around(grey: Image, rim: Rim) -> Image:
    """Return what a shaft stands out from, (h, w)."""
    return np.asarray(cv2.medianBlur(grey, 2 * round(1.5 * LINE_WIDTH * rim.inner.radius_px) + 1), np.uint8)


def _stands_out(grey: Image, around: Image) -> Image:
    """Return how much an image in grey differs from another one, (h, w)."""
    return np.asarray(cv2.blur(cv2.absdiff(grey, around), (3, 3)), np.uint8)


def _moving(images: Sequence[Image], rim: Rim) -> NDArray[np.bool_]:
    """Return where images differ, and a little around: (h, w)."""
    brightest = darkest = cv2.blur(images[0], (3, 3))
    for image in images[1:]:
        smooth = cv2.blur(image, (3, 3))
        brightest, darkest = np.maximum(brightest, smooth), np.minimum(darkest, smooth)
    change = cv2.subtract(brightest, darkest)
    size = change if change.ndim == 2 else change.max(axis=2)
    noise = float(np.median(size))
    moved = (size > max(LEAST_CHANGE_GREY, 2.5 * noise)).astype(np.uint8)
    side = 2 * round(LINE_WIDTH * rim.inner.radius_px) + 1
    return np.asarray(cv2.dilate(cv2.erode(moved, np.ones((3, 3))), np.ones((side, side)))) > 0


def _visible(rim: Rim, width_px: int, height_px: int) -> NDArray[np.bool_]:
    """Return where a needle is not hidden by the wall, nor cut by the image's border: (h, w)."""
    y, x = np.ogrid[:height_px, :width_px]
    inner, outer = rim.inner, rim.outer or rim.inner
    distance = np.hypot(x - inner.center_px[0], y - inner.center_px[1])
    border = 1.5 * LINE_WIDTH * inner.radius_px
    whole = (x > border) & (x < width_px - border) & (y > border)
    outside = (distance > outer.radius_px * 1.02) & (y < inner.center_px[1] - 0.2 * inner.radius_px)
    return np.asarray(((distance < inner.radius_px * 0.97) | outside) & whole)


def _shaft(grey: Image, size: Image, visible: NDArray[np.bool_], rim: Rim) -> ShaftLine | None:
    """Fit the straight thin thing that stands out from what lies around it.

    Args:
        grey: The image, (h, w).
        size: How much it stands out there, (h, w).
        visible: Where it is looked for, (h, w).
        rim: Where the wall is.
    """
    radius_px = rim.inner.radius_px
    points = _places(size, visible, LEAST_CHANGE_GREY)
    if len(points) < 50:
        return None
    line = _straightest(points[:: len(points) // MOST_POINTS + 1], LINE_WIDTH * radius_px / 3, rim)
    if line is None:
        return None
    across = np.abs((points - line.point_px) @ line.normal)
    x, y = points[across < LINE_WIDTH * radius_px / 4].astype(int).T
    points = _places(size, visible, max(LEAST_CHANGE_GREY, 0.5 * float(np.quantile(size[y, x], 0.7))))
    for width_px in (LINE_WIDTH * radius_px, 0.8 * LINE_WIDTH * radius_px, 0.8 * LINE_WIDTH * radius_px):
        line = _middle(points, line, width_px, radius_px) if line else None
    if line is None or not _enters(points, line, rim):
        return None
    return _between_edges(grey, points, line, radius_px)


def _enters(points: Floats, line: ShaftLine, rim: Rim) -> bool:
    """Tell whether enough of the shaft is seen inside the globe: from outside, its line has far to go."""
    inside = np.hypot(*(points - rim.inner.center_px).T) < rim.inner.radius_px
    relative = points[inside] - line.point_px
    near = np.abs(relative @ line.normal) < LINE_WIDTH * rim.inner.radius_px / 2
    stations = np.unique(np.floor(relative[near] @ line.along / (STATION * rim.inner.radius_px)))
    return bool(len(stations) * STATION >= SHORTEST)


def _places(size: Image, visible: NDArray[np.bool_], least: float) -> Floats:
    """Return where something stands out, (n, 2)."""
    y, x = np.nonzero((size > least) & visible)
    return np.stack([x, y], axis=1).astype(float)


def _straightest(points: Floats, width_px: float, rim: Rim) -> ShaftLine | None:
    """Return the line through two points that most points lie on, of those that cross the upper wall."""
    rng = np.random.default_rng(0)
    first, second = points[rng.integers(0, len(points), (2, TRIALS))]
    away = second - first
    length = np.hypot(*away.T)
    kept = length > 0.3 * SHORTEST * rim.inner.radius_px
    first, along = first[kept], away[kept] / length[kept][:, None]
    up = _crosses_upper_wall(first, along, rim)
    first, along = first[up], along[up]
    if not len(first):
        return None
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    off = np.abs(points @ normal.T - np.sum(first * normal, axis=1))
    best = int((off < width_px).sum(axis=0).argmax())
    return ShaftLine(first[best], along[best], 0.0)


def _crosses_upper_wall(points: Floats, along: Floats, rim: Rim) -> NDArray[np.bool_]:
    """Tell which lines enter the globe from above."""
    center = np.array(rim.inner.center_px)
    from_center = points - center
    middle = np.sum(from_center * along, axis=1)
    off = np.sum(from_center**2, axis=1) - middle**2
    half = np.sqrt(np.maximum((1.07 * rim.inner.radius_px) ** 2 - off, 0))
    upwards = along * -np.sign(along[:, 1:2])
    middle = np.sum(from_center * upwards, axis=1)
    entry = from_center + upwards * (half - middle)[:, None]
    return np.asarray((off < (0.95 * rim.inner.radius_px) ** 2) & (entry[:, 1] < -0.2 * rim.inner.radius_px))


def _middle(points: Floats, line: ShaftLine, width_px: float, radius_px: float) -> ShaftLine | None:
    """Fit a line to the middle of what stands out, station by station."""
    relative = points - line.point_px
    along, across = relative @ line.along, relative @ line.normal
    near = np.abs(across) < width_px
    along, across = along[near], across[near]
    if not len(along):
        return None
    station = np.floor((along - along.min()) / (STATION * radius_px)).astype(int)
    count = np.bincount(station)
    full = count >= 0.4 * np.median(count[count > 0])
    if full.sum() * STATION < SHORTEST:
        return None
    middles, offs = (np.bincount(station, v)[full] / count[full] for v in (along, across))
    return _fitted(line, middles, offs, float(full.sum()) * STATION * radius_px)


def _between_edges(grey: Image, points: Floats, line: ShaftLine, radius_px: float) -> ShaftLine | None:
    """Fit the line midway between the shaft's two edges, each where the image is steepest."""
    relative = points - line.point_px
    near = np.abs(relative @ line.normal) < LINE_WIDTH * radius_px / 2
    stations, count = np.unique(np.rint(relative[near] @ line.along / 2), return_counts=True)
    along = 2 * stations[count >= 3]
    away = np.arange(0.0, LINE_WIDTH * radius_px, EDGE_STEP_PX)
    smooth = np.asarray(cv2.GaussianBlur(grey, (0, 0), 1.0)).astype(np.float32)
    edges = []
    for side in (-1, 1):
        places = line.point_px + along[:, None, None] * line.along + side * away[:, None] * line.normal
        x, y = places.astype(np.float32).transpose(2, 0, 1)
        profile = cv2.remap(smooth, x, y, cv2.INTER_LINEAR)
        steep = np.abs(np.gradient(profile, axis=1))
        best = _outermost(steep)
        before, at, after = (steep[np.arange(len(along)), best + d] for d in (-1, 0, 1))
        edges.append(side * (away[best] + top_shift(before, at, after) * EDGE_STEP_PX))
    width = edges[1] - edges[0]
    # A tapering shaft: compare each width with that of the stations around it.
    usual = np.array([np.median(width[max(i - 15, 0) : i + 16]) for i in range(len(width))])
    kept = np.abs(width - usual) < np.maximum(0.15 * usual, 1.0)
    if kept.sum() * 2 < SHORTEST * radius_px:
        return None
    middle = (edges[0] + edges[1]) / 2
    return _fitted(line, along[kept], middle[kept], float(kept.sum()) * 2)


def _outermost(steep: Floats) -> NDArray[np.int_]:
    """Return each row's last clear peak: a bright shaft has steep places between its edges, too."""
    is_peak = (steep[:, 1:-1] >= steep[:, :-2]) & (steep[:, 1:-1] >= steep[:, 2:])
    is_peak &= steep[:, 1:-1] >= CLEAR_EDGE * steep.max(axis=1, keepdims=True)
    last = is_peak.shape[1] - np.argmax(is_peak[:, ::-1], axis=1)
    return np.asarray(np.where(is_peak.any(axis=1), last, 1))


def _fitted(line: ShaftLine, along: Floats, across: Floats, length_px: float) -> ShaftLine:
    """Turn and shift a line so that it passes, without outliers, through places given in its own frame."""
    weight = np.ones(len(along))
    slope = offset = 0.0
    for _ in range(8):
        slope, offset = np.polyfit(along, across, 1, w=weight)
        off = np.abs(across - slope * along - offset)
        weight = 1 / np.maximum(off / max(float(np.median(off)) * 1.5, 0.05), 1)
    direction = line.along + slope * line.normal
    point = line.point_px + offset * line.normal + float(along.mean()) * direction
    return ShaftLine(point, direction / np.hypot(*direction), length_px)
