"""A perceiver for simulated studies: the simulator's ground truth with the tracker's measured noise.

Replaces perception where thousands of trials are simulated without rendering. It is in no registry, and
results name it. Other errors of the tracker (shadows, missed or late detections) are not simulated.
"""

import math
from bisect import bisect_right
from collections.abc import Iterator

import numpy as np

from haptigraph.geometry import Point, Segment, rotate, subtract, unit
from haptigraph.messages import Capture, Certainty, Observation
from haptigraph.registration.camera import Registration

__all__ = ["GROUND_TRUTH", "OLD_NAMES", "GroundTruthPerceiver", "angle_noise_deg"]

GROUND_TRUTH = "ground-truth"
"""Selects it in place of a registered perceiver."""
OLD_NAMES = {"known": GROUND_TRUTH}
"""Its name in earlier versions, which is still read."""

# docs/explanation/accuracy.md, perceiver `tracker`, 66 simulated scenes.
NOISE_DEPTHS_MM = (1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 18.0)
NOISE_DEG = (0.0258, 0.0242, 0.00835, 0.0385, 0.00897, 0.00595, 0.00325)  # from image to image
ERROR_DEG, SHALLOW_ERROR_DEG, SHALLOW_MM = 0.0219, 0.0518, 3.0  # median of the error, below and up to a depth
TIP_ERROR_MM = 0.416 / 20  # median
MEDIAN_OF_NORMAL, MEDIAN_OF_RAYLEIGH = 0.6745, 1.1774  # relative to their scale parameter
DRAWN = 64  # images whose noise is drawn at once, which is faster
MIN_DEPTH_MM = 1.0  # closer to the RCM the tip is still within the wall


class GroundTruthPerceiver:
    """Observe the true needle with simulated errors.

    The angle has a constant error and noise from image to image, as large as the tracker's at that depth.
    The noise of the tip is as large as the tracker's total error, that is, larger than its noise.

    Args:
        registration: The registered anatomy.
        seed: Of the noise.
    """

    def __init__(self, registration: Registration, seed: tuple[int, ...]) -> None:
        self._anatomy, self._seed = registration.anatomy, seed
        self._trocar_mm = registration.trocar.at_mm
        self.reset()

    def reset(self) -> None:
        """Restart the noise."""
        rng = np.random.default_rng(self._seed)
        self._offset = float(rng.standard_normal())
        self._noise = _noise(rng)

    def __call__(self, capture: Capture) -> Observation:
        """Return the needle of a capture's ground truth, unless its tip is not visible."""
        truth, found = capture.truth, self._anatomy
        noise, noise_x, noise_y = next(self._noise)
        if truth is None or not truth.visible or abs(truth.depth_mm) < MIN_DEPTH_MM:
            return Observation(capture.stamp_ns, dict(found))
        error_deg = SHALLOW_ERROR_DEG if truth.depth_mm <= SHALLOW_MM else ERROR_DEG
        angle_error_deg = self._offset * error_deg / MEDIAN_OF_NORMAL
        angle_error_deg += noise * angle_noise_deg(truth.depth_mm)
        sd_mm = TIP_ERROR_MM / MEDIAN_OF_RAYLEIGH
        x, y = truth.tip_mm
        tip_mm = x + sd_mm * noise_x, y + sd_mm * noise_y
        inwards = math.copysign(1, truth.depth_mm)
        shaft = unit(subtract(truth.tip_mm, self._trocar_mm))
        along = rotate((inwards * shaft[0], inwards * shaft[1]), angle_error_deg)
        length_mm = max(truth.depth_mm, 1.0)
        entry_mm = tip_mm[0] - length_mm * along[0], tip_mm[1] - length_mm * along[1]
        return Observation(
            capture.stamp_ns,
            found | {"needle_tip": Point(tip_mm), "needle_line": Segment(entry_mm, tip_mm)},
            certainty=Certainty(1.0, sd_mm, error_deg / MEDIAN_OF_NORMAL),
        )


def angle_noise_deg(depth_mm: float) -> float:
    """Return the SD of the angle from image to image at a depth, interpolated.

    `numpy.interp` would do the same, but gives up the interpreter each time, and then waits for the recorder.
    """
    after = bisect_right(NOISE_DEPTHS_MM, depth_mm)
    if not 0 < after < len(NOISE_DEG):
        return NOISE_DEG[max(after - 1, 0)]
    (x, next_x), (y, next_y) = NOISE_DEPTHS_MM[after - 1 : after + 1], NOISE_DEG[after - 1 : after + 1]
    return (next_y - y) / (next_x - x) * (depth_mm - x) + y


def _noise(rng: np.random.Generator) -> Iterator[list[float]]:
    """Yield the noise of each image: of the angle, and of the tip in x and y."""
    while True:
        yield from rng.standard_normal((DRAWN, 3)).tolist()
