"""The perceiver `threshold`: adaptive Gaussian threshold, contours, line fit, moving average (paper, II-B).

It searches only the inside of the globe: a needle outside it or in the wall is not detected.
"""

import math
from collections.abc import Iterator

import cv2
import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from haptigraph.config import PerceptionConfig
from haptigraph.geometry import Geometry, Point, Segment, Vec, norm, subtract, unit
from haptigraph.imaging import FloatImage, Floats, Mask, grey_of
from haptigraph.messages import Capture, Image, ImageKind, Observation
from haptigraph.perception.baseline.smoothing import MovingAverage
from haptigraph.perception.entities import ENTITIES
from haptigraph.registration.camera import Registration

__all__ = ["ThresholdPerceiver", "ThresholdStages"]

MIN_LENGTH_MM = 0.8  # shorter blobs have no reliable direction
MIN_ELONGATION = 3.0  # length over width; texture and holes are rounder
MAX_TROCAR_MISS_MM = 0.5  # of a needle's line from its trocar
MAX_START_MM = 2.5  # of a needle's near end from its trocar: wall and hole occlude the first part
RIM_PX = 1.5  # blurred edge of the wall, not searched
PORT_RADIUS_MM = 1.2  # around the RCM, not searched: the trocar's hole through the wall resembles a needle


class _Line(Struct, frozen=True):
    """The axis of a blob, in pixels of the region; positions along it are measured from its centre."""

    center: Vec
    direction: Vec
    near_px: float
    far_px: float
    width_px: float
    trocar_px: float
    """Point of the line nearest to the trocar."""
    miss_px: float
    """Distance of the line from the trocar."""

    def at(self, along_px: float) -> Vec:
        """Return the point at a position along the line."""
        return self.center[0] + along_px * self.direction[0], self.center[1] + along_px * self.direction[1]


class _Blob(Struct, frozen=True, eq=False):
    """A needle candidate."""

    contrast_grey: float
    """Summed over its pixels."""
    line: _Line
    contour: NDArray[np.int32]
    """(n, 1, 2), pixels of the region."""


class ThresholdStages(Struct, frozen=True, eq=False):
    """What the stages make of one image, for figures; positions are pixels of the image."""

    corner_px: tuple[int, int]
    """Of the region that is searched: left, top."""
    above_mean: FloatImage
    """Difference from the local mean where the needle is searched, (h, w) of the region [grey levels]."""
    is_over: Mask
    """Pixels over the threshold, (h, w) of the region."""
    contour_px: NDArray[np.int32] | None
    """Contour of the needle, (n, 2); None if none was found."""
    ends_px: Floats | None
    """Near end of the fitted axis, and tip, (2, 2)."""


class ThresholdPerceiver:
    """Find the needle as the strongest elongated blob that points at the trocar.

    Args:
        registration: Geometry of globe and trocar.
        config: Polarity, block size, offset, alpha.
    """

    images: ImageKind = "eye"
    entities = ENTITIES["threshold"]
    entities_with_sd = frozenset[str]()
    """Entities it may report besides the registered anatomy."""

    def __init__(self, registration: Registration, config: PerceptionConfig) -> None:
        self._registration = registration
        self._config = config
        self._smooth = MovingAverage(config.alpha)
        image = registration.image
        radius_px = registration.globe.radius_mm / image.mm_per_px
        self._left, self._top = (max(0, math.floor(c - radius_px)) for c in image.center_px)
        right = min(registration.width_px, math.ceil(image.center_px[0] + radius_px) + 1)
        bottom = min(registration.height_px, math.ceil(image.center_px[1] + radius_px) + 1)
        self._region = np.s_[self._top : bottom, self._left : right]
        self._trocar = self._in_region(image.to_px(registration.trocar.at_mm))
        center, size = self._in_region(image.center_px), (bottom - self._top, right - self._left)
        self._inside = (_distances(center, size) <= radius_px - RIM_PX).astype(np.float32)
        self._weight = np.maximum(self._blur(self._inside), 1e-3)
        self._searched = self._inside * (_distances(self._trocar, size) > PORT_RADIUS_MM / image.mm_per_px)

    def __call__(self, capture: Capture) -> Observation:
        """Process one image.

        Raises:
            BadInput: If the image is not of the registered size.
        """
        found: dict[str, Geometry] = dict(self._registration.anatomy)
        line = self._detect(self._grey(capture.image))
        if line is None:
            self._smooth.reset()
        else:
            found |= self._needle(line)
        return Observation(capture.stamp_ns, found)

    def reset(self) -> None:
        """Forget earlier images."""
        self._smooth.reset()

    def stages(self, image: Image) -> ThresholdStages:
        """Return what every stage before the moving average makes of an image.

        Raises:
            BadInput: If the image is not of the registered size.
        """
        above_mean = self._above_mean(self._grey(image))
        over = [strength > self._config.offset_grey for strength in self._strengths(above_mean)]
        corner, found = (self._left, self._top), self._strongest(above_mean)
        if found is None:
            return ThresholdStages(corner, above_mean, np.logical_or.reduce(over), None, None)
        ends = np.array([found.line.at(found.line.near_px), found.line.at(found.line.far_px)])
        contour = found.contour[:, 0, :] + np.array(corner)
        return ThresholdStages(corner, above_mean, np.logical_or.reduce(over), contour, ends + corner)

    def _grey(self, image: Image | None) -> FloatImage:
        image = self._registration.checked(image)
        region = image[self._region]
        return grey_of(region).astype(np.float32)

    def _in_region(self, at_px: Vec) -> Vec:
        return at_px[0] - self._left, at_px[1] - self._top

    def _blur(self, image: FloatImage) -> FloatImage:
        size = (self._config.block_size_px,) * 2
        return np.asarray(cv2.GaussianBlur(image, size, 0, borderType=cv2.BORDER_CONSTANT), np.float32)

    def _detect(self, grey: FloatImage) -> _Line | None:
        found = self._strongest(self._above_mean(grey))
        return found.line if found else None

    def _above_mean(self, grey: FloatImage) -> FloatImage:
        # The local mean covers the inside only, so that a bright wall does not hide a bright needle near it.
        mean = self._blur(np.multiply(grey, self._inside, dtype=np.float32)) / self._weight
        return np.asarray((grey - mean) * self._searched, np.float32)

    def _strengths(self, above_mean: FloatImage) -> list[FloatImage]:
        signs = {"dark": (-1,), "bright": (1,), "auto": (-1, 1)}[self._config.polarity]
        return [sign * above_mean for sign in signs]

    def _strongest(self, above_mean: FloatImage) -> _Blob | None:
        blobs = (blob for strength in self._strengths(above_mean) for blob in self._blobs(strength))
        return max(blobs, key=lambda blob: blob.contrast_grey, default=None)

    def _blobs(self, strength: FloatImage) -> Iterator[_Blob]:
        """Yield every needle candidate.

        Total contrast, the summed difference from the local mean, is largest for a needle: the halo beside a
        bright needle is as long but far fainter.
        """
        over = (strength > self._config.offset_grey).astype(np.uint8)
        contours, _ = cv2.findContours(over, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        min_length_px = MIN_LENGTH_MM / self._registration.image.mm_per_px
        for contour in contours:
            left, top, width, height = cv2.boundingRect(contour)
            if math.hypot(width, height) < min_length_px:
                continue
            line = self._fit_line(np.asarray(contour, np.int32))
            if line is not None and self._is_needle(line):
                filled = np.zeros((height, width), np.uint8)
                cv2.drawContours(filled, [contour], 0, 1, cv2.FILLED, offset=(-left, -top))
                box = strength[top : top + height, left : left + width]
                yield _Blob(float((box * filled).sum()), line, np.asarray(contour, np.int32))

    def _fit_line(self, contour: NDArray[np.int32]) -> _Line | None:
        """Fit the axis of least inertia of a filled contour (total least squares), away from the trocar."""
        moments = cv2.moments(contour)
        if moments["m00"] == 0.0:
            return None
        center = moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]
        turn = math.atan2(2 * moments["mu11"], moments["mu20"] - moments["mu02"]) / 2
        direction = math.cos(turn), math.sin(turn)
        to_trocar = subtract(self._trocar, center)
        if direction[0] * to_trocar[0] + direction[1] * to_trocar[1] > 0:
            direction = -direction[0], -direction[1]
        along = (contour[:, 0, :] - np.asarray(center)) @ np.asarray(direction)
        return _Line(
            center,
            direction,
            near_px=float(along.min()),
            far_px=float(along.max()),
            width_px=moments["m00"] / float(np.ptp(along)),
            trocar_px=direction[0] * to_trocar[0] + direction[1] * to_trocar[1],
            miss_px=abs(direction[0] * to_trocar[1] - direction[1] * to_trocar[0]),
        )

    def _is_needle(self, line: _Line) -> bool:
        mm_per_px = self._registration.image.mm_per_px
        length_px = line.far_px - line.near_px
        return (
            length_px * mm_per_px >= MIN_LENGTH_MM
            and length_px >= MIN_ELONGATION * line.width_px
            and line.miss_px * mm_per_px <= MAX_TROCAR_MISS_MM
            and (line.near_px - line.trocar_px) * mm_per_px <= MAX_START_MM
        )

    def _needle(self, line: _Line) -> dict[str, Geometry]:
        """Convert the line to smoothed entities in the eye frame."""
        tip, entry = self._to_mm(line.at(line.far_px)), self._to_mm(line.at(line.trocar_px))
        shaft = subtract(tip, entry)
        length = norm(shaft)
        tip, direction = self._smooth(tip, unit(shaft))
        entry = tip[0] - length * direction[0], tip[1] - length * direction[1]
        return {"needle_tip": Point(tip), "needle_line": Segment(entry, tip)}

    def _to_mm(self, in_region: Vec) -> Vec:
        return self._registration.image.to_mm((in_region[0] + self._left, in_region[1] + self._top))


def _distances(point: Vec, size: tuple[int, int]) -> FloatImage:
    """Return every pixel's distance from a point [px], (h, w)."""
    y, x = np.ogrid[: size[0], : size[1]]
    return np.hypot(x - point[0], y - point[1]).astype(np.float32)
