"""From the probability of metal to the needle's line and tip.

Turns one class's map (px) into straight lines, those with most evidence first. Whether a line is a needle or
a ghost, and whether it goes on inside tissue, is for the caller to say, who knows where light is missing.
Knows no network and no millimetres.
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
SHORTEST_PX = 16.0  # of the map
OFF_LINE_PX = 3.0
GAP_PX = 12.0  # between the end of the line and the bevel's last blob
LEAST_RATIO = 3.0  # length over width of what is a line
LEAST_SHARE = 0.3  # of a piece must be on its line: less, and it is a blob
TURN_RAD = math.radians(1.0)
WITHIN_PX, MOST = (4.0, 3.0, 2.0, 2.0), 3


class NeedleFit(Struct, frozen=True):
    """A needle in an image; pixels of the image."""

    tip_px: Vec
    entry_px: Vec
    """Where the line enters the image, or is first seen."""
    tip_sd_px: float
    """Along the shaft."""
    angle_sd_deg: float
    confidence: float
    """Mean probability along the line."""


def fit_needles(on: FloatImage, scaling: Scaling, least_confidence: float) -> list[NeedleFit]:
    """Return what may be a needle in its class's probability, (h, w)."""
    left = on >= least_confidence
    found: list[NeedleFit] = []
    for _ in range(MOST):
        piece = _largest(left)
        if piece is None:
            break
        left &= ~piece
        line = _followed(on, piece, least_confidence)
        fit = line and _measured(on, line, scaling, least_confidence)
        if line and fit:
            found.append(fit)
            y, x = np.nonzero(left)
            near = np.abs(line.off(x, y)) <= 2 * OFF_LINE_PX
            left[y[near], x[near]] = False
    return found


def _largest(mask: Mask) -> Mask | None:
    """Return the largest connected piece; None if it is too small for a line."""
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    areas = stats[1:, cv2.CC_STAT_AREA]
    if count < 2 or areas.max() < SHORTEST_PX:
        return None
    return np.asarray(labels == 1 + int(areas.argmax()))


def _followed(on: FloatImage, piece: Mask, least_confidence: float) -> "_Line | None":
    """Return the strongest line of a piece, through all of the class near it."""
    y, x = np.nonzero(on >= least_confidence)
    weights = on[y, x]
    strongest = cv2.HoughLines(piece.astype(np.uint8), 1.0, TURN_RAD, int(SHORTEST_PX))
    if strongest is None:
        return None
    rho, theta = (float(value) for value in strongest[0, 0])
    off = np.abs(x * math.cos(theta) + y * math.sin(theta) - rho)
    line = None
    for (
        within_px
    ) in WITHIN_PX:  # ever nearer: a ghost that meets the needle, or a smear in tissue, must not turn it
        near = off <= within_px
        line = _line_through(x[near], y[near], weights[near])
        if line is None:
            return None
        off = np.abs(line.off(x, y))
    piece_y, piece_x = np.nonzero(piece)
    is_on_it = np.abs(line.off(piece_x, piece_y)) <= OFF_LINE_PX if line else np.zeros(1)
    return line if is_on_it.mean() >= LEAST_SHARE else None


class _Line(NamedTuple):
    """A straight line through weighted pixels of a map."""

    center: Vec
    along: Vec
    """Length 1, downwards."""
    from_px: float
    to_px: float
    angle_sd_rad: float

    def off(self, x: Numbers, y: Numbers) -> Numbers:
        """Return how far places are beside the line."""
        return self.along[0] * (y - self.center[1]) - self.along[1] * (x - self.center[0])

    def at(self, along_px: float) -> Vec:
        """Return a place on the line."""
        return self.center[0] + along_px * self.along[0], self.center[1] + along_px * self.along[1]


def _line_through(x: Numbers, y: Numbers, weight: Numbers) -> _Line | None:
    if len(x) < SHORTEST_PX:
        return None
    total = float(weight.sum())
    center = float((weight * x).sum()) / total, float((weight * y).sum()) / total
    dx, dy = x - center[0], y - center[1]
    spread = np.array([[(weight * a * b).sum() / total for a in (dx, dy)] for b in (dx, dy)])
    (narrow, wide), axes = np.linalg.eigh(spread)
    along = (float(axes[0, 1]), float(axes[1, 1]))
    along = along if along[1] >= 0 else (-along[0], -along[1])
    reach = along[0] * dx + along[1] * dy
    length = float(reach.max() - reach.min())
    if length < SHORTEST_PX or wide < LEAST_RATIO**2 * max(narrow, 1e-6):
        return None
    # A pixel of a thin line is off it by chance, but its neighbours across share that chance.
    deviation = math.sqrt(max(narrow, 0.05) / (length * max(wide, 1e-6)))
    return _Line(center, along, float(reach.min()), float(reach.max()), deviation)


def _measured(on: FloatImage, line: _Line, scaling: Scaling, least_confidence: float) -> NeedleFit | None:
    """Follow the line to its tip: the last place where its class is as probable as not."""
    height, width = on.shape
    far = math.hypot(height, width)
    steps = np.arange(line.from_px - 2, min(line.to_px + GAP_PX + 8, far), 0.5)
    xs, ys = (line.center[axis] + steps * line.along[axis] for axis in (0, 1))
    profile = np.max(
        [
            cv2.remap(
                on,
                (xs - shift * line.along[1]).astype(np.float32)[None],
                (ys + shift * line.along[0]).astype(np.float32)[None],
                cv2.INTER_LINEAR,
                borderMode=cv2.BORDER_CONSTANT,
            )[0]
            for shift in (-0.5, 0.0, 0.5)
        ],
        axis=0,
    )
    seen = np.nonzero(profile >= least_confidence)[0]
    breaks = np.nonzero(np.diff(seen) * 0.5 > GAP_PX)[0]
    runs = np.split(seen, breaks + 1)
    run = max(runs, key=len, default=seen)
    if len(run) * 0.5 < SHORTEST_PX:
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
