"""Needle candidates from the probability map of a network's needle class.

Turns the map (px) into straight lines with tips, those with most evidence first. The caller decides which
line is a needle (`class_shadow`), and whether it continues inside tissue.
"""

import math
from typing import Any, NamedTuple, TypeAlias

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.geometry import Vec
from haptigraph.imaging import FloatImage, Mask
from haptigraph.perception.oct.class_maps import Scaling

__all__ = ["NeedleFit", "fit_needles"]

Numbers: TypeAlias = NDArray[Any]
MIN_LENGTH_MM = 0.18
GAP_MM = 0.14  # between the end of the line and the bevel's last bright spot
MIN_PIXELS = 14  # of a component, and along a line
ON_LINE_PX = 3.0  # in pixels of the map, in which every line has about the same width
MIN_ELONGATION = 3.0  # length over width of a line
MIN_INLIER_SHARE = 0.3  # of a component; with fewer pixels on its line it is a blob
TURN_RAD = math.radians(1.0)
INLIER_PX, MAX_NEEDLES = (4.0, 3.0, 2.0, 2.0), 3


class NeedleFit(Struct, frozen=True):
    """A needle candidate; pixels of the image."""

    tip_px: Vec
    entry_px: Vec
    """Where the line enters the image, or is first visible."""
    tip_sd_px: float
    """Along the shaft."""
    angle_sd_deg: float
    confidence: float
    """Mean probability along the line."""


def fit_needles(probability: FloatImage, scaling: Scaling, least_confidence: float) -> list[NeedleFit]:
    """Return the needle candidates in a map of probabilities, (h, w)."""
    remaining = probability >= least_confidence
    found: list[NeedleFit] = []
    for _ in range(MAX_NEEDLES):
        component = _largest_component(remaining)
        if component is None:
            break
        remaining &= ~component
        line = _strongest_line(probability, component, least_confidence)
        fit = line and _fit_needle(probability, line, scaling, least_confidence)
        if line and fit:
            found.append(fit)
            y, x = np.nonzero(remaining)
            near = np.abs(line.distance_to(x, y)) <= 2 * ON_LINE_PX
            remaining[y[near], x[near]] = False
    return found


def _largest_component(mask: Mask) -> Mask | None:
    """Return the largest connected component; None if it is too small for a line."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    areas = stats[1:, cv2.CC_STAT_AREA]
    if count < 2 or areas.max() < MIN_PIXELS:
        return None
    return np.asarray(labels == 1 + int(areas.argmax()))


def _strongest_line(probability: FloatImage, component: Mask, least_confidence: float) -> "_Line | None":
    """Fit the strongest line of a component to all pixels of the class near it."""
    y, x = np.nonzero(probability >= least_confidence)
    weights = probability[y, x]
    strongest = cv2.HoughLines(component.astype(np.uint8), 1.0, TURN_RAD, MIN_PIXELS)
    if strongest is None:
        return None
    rho, theta = (float(value) for value in strongest[0, 0])
    distance = np.abs(x * math.cos(theta) + y * math.sin(theta) - rho)
    line = None
    # Ever narrower, so that a ghost that meets the needle, or a smear in tissue, does not rotate the line.
    for inlier_px in INLIER_PX:
        near = distance <= inlier_px
        line = _line_through(x[near], y[near], weights[near])
        if line is None:
            return None
        distance = np.abs(line.distance_to(x, y))
    component_y, component_x = np.nonzero(component)
    is_on_it = np.abs(line.distance_to(component_x, component_y)) <= ON_LINE_PX if line else np.zeros(1)
    return line if is_on_it.mean() >= MIN_INLIER_SHARE else None


class _Line(NamedTuple):
    """A straight line through weighted pixels of a map."""

    center: Vec
    along: Vec
    """Length 1, downwards."""
    from_px: float
    to_px: float
    angle_sd_rad: float

    def distance_to(self, x: Numbers, y: Numbers) -> Numbers:
        """Return the signed distances of points to the line."""
        return self.along[0] * (y - self.center[1]) - self.along[1] * (x - self.center[0])

    def at(self, along_px: float) -> Vec:
        """Return a point on the line."""
        return self.center[0] + along_px * self.along[0], self.center[1] + along_px * self.along[1]


def _line_through(x: Numbers, y: Numbers, weight: Numbers) -> _Line | None:
    if len(x) < MIN_PIXELS:
        return None
    total = float(weight.sum())
    center = float((weight * x).sum()) / total, float((weight * y).sum()) / total
    dx, dy = x - center[0], y - center[1]
    spread = np.array([[(weight * a * b).sum() / total for a in (dx, dy)] for b in (dx, dy)])
    (narrow, wide), axes = np.linalg.eigh(spread)
    along = (float(axes[0, 1]), float(axes[1, 1]))
    along = along if along[1] >= 0 else (-along[0], -along[1])
    along_line = along[0] * dx + along[1] * dy
    length = float(along_line.max() - along_line.min())
    if length < MIN_PIXELS or wide < MIN_ELONGATION**2 * max(narrow, 1e-6):
        return None
    # The random offsets of neighbouring pixels across a thin line are correlated: count only its length.
    angle_sd_rad = math.sqrt(max(narrow, 0.05) / (length * max(wide, 1e-6)))
    return _Line(center, along, float(along_line.min()), float(along_line.max()), angle_sd_rad)


def _fit_needle(
    probability: FloatImage, line: _Line, scaling: Scaling, least_confidence: float
) -> NeedleFit | None:
    """Follow a line to its tip, where the probability of its class falls below the minimum."""
    height, width = probability.shape
    far = math.hypot(height, width)
    mm_per_px = math.hypot(line.along[0] * scaling.column_mm, line.along[1] * scaling.row_mm)
    gap_px = GAP_MM / mm_per_px
    steps = np.arange(line.from_px - 2, min(line.to_px + gap_px + 8, far), 0.5)
    xs, ys = (line.center[axis] + steps * line.along[axis] for axis in (0, 1))
    profile = np.max(
        [
            cv2.remap(
                probability,
                (xs - shift * line.along[1]).astype(np.float32)[None],
                (ys + shift * line.along[0]).astype(np.float32)[None],
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_CONSTANT,
            )[0]
            for shift in (-0.5, 0.0, 0.5)
        ],
        axis=0,
    )
    visible = np.nonzero(profile >= least_confidence)[0]
    breaks = np.nonzero(np.diff(visible) * 0.5 > gap_px)[0]
    runs = np.split(visible, breaks + 1)
    run = max(runs, key=len, default=visible)
    if len(run) * 0.5 * mm_per_px < MIN_LENGTH_MM:
        return None
    last = int(run[-1])
    after = float(profile[last + 1]) if last + 1 < len(profile) else 0.0
    over = (float(profile[last]) - least_confidence) / max(float(profile[last]) - after, 1e-6)
    tip = float(steps[last]) + 0.5 * min(max(over, 0.0), 1.0)
    fading = np.clip(profile[last - min(last, 20) : last + 20], 0, 1)
    soft_px = 0.5 * float((4 * fading * (1 - fading)).sum())
    start = float(steps[run[0]])
    tip_px, entry_px = (scaling.to_image(line.at(at)) for at in (tip, start))
    return NeedleFit(
        tip_px=tip_px,
        entry_px=entry_px,
        tip_sd_px=max(0.5, soft_px / 2)
        * math.hypot(line.along[0] * scaling.across, line.along[1] * scaling.down),
        angle_sd_deg=math.degrees(line.angle_sd_rad),
        confidence=float(profile[run[0] : last + 1].mean()),
    )
