"""A perceiver for simulated studies: the simulator's ground truth with the tracker's measured noise.

Replaces perception where thousands of trials are simulated without rendering. It is in no registry, and
results name it. Other errors of the tracker (shadows, missed or late detections) are not simulated.
"""

import math

import numpy as np

from haptigraph.geometry import Geometry, Point, Segment, rotate, subtract, unit
from haptigraph.messages import Capture, Certainty, Observation
from haptigraph.registration.camera import Registration

__all__ = ["GROUND_TRUTH", "OLD_NAMES", "GroundTruthPerceiver"]

GROUND_TRUTH = "ground-truth"
"""Selects it in place of a registered perceiver."""
OLD_NAMES = {"known": GROUND_TRUTH}
"""Its name in earlier versions, which is still read."""

# docs/accuracy.md, perceiver `tracker`, 66 simulated scenes.
NOISE_DEPTHS_MM = (1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 18.0)
NOISE_DEG = (0.0258, 0.0242, 0.00835, 0.0385, 0.00897, 0.00595, 0.00325)  # from image to image
ERROR_DEG = ((3.0, 0.0518), (math.inf, 0.0219))  # median of the error up to a depth
TIP_ERROR_MM = 0.416 / 20  # median
MEDIAN_OF_NORMAL, MEDIAN_OF_RAYLEIGH = 0.6745, 1.1774  # relative to their scale parameter
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
        self._registration, self._seed = registration, seed
        self.reset()

    def reset(self) -> None:
        """Restart the noise."""
        self._rng = np.random.default_rng(self._seed)
        self._offset = float(self._rng.standard_normal())

    def __call__(self, capture: Capture) -> Observation:
        """Return the needle of a capture's ground truth, unless its tip is not visible."""
        truth, found = capture.truth, dict[str, Geometry](self._registration.anatomy)
        noise = self._rng.standard_normal(3)
        if truth is None or not truth.visible or abs(truth.depth_mm) < MIN_DEPTH_MM:
            return Observation(capture.stamp_ns, found)
        trocar_mm = self._registration.trocar.at_mm
        error_deg = next(error for depth_mm, error in ERROR_DEG if truth.depth_mm <= depth_mm)
        angle_error_deg = self._offset * error_deg / MEDIAN_OF_NORMAL
        angle_error_deg += float(noise[0]) * float(np.interp(truth.depth_mm, NOISE_DEPTHS_MM, NOISE_DEG))
        sd_mm = TIP_ERROR_MM / MEDIAN_OF_RAYLEIGH
        x, y = truth.tip_mm
        tip_mm = x + sd_mm * float(noise[1]), y + sd_mm * float(noise[2])
        inwards = math.copysign(1, truth.depth_mm)
        shaft = unit(subtract(truth.tip_mm, trocar_mm))
        along = rotate((inwards * shaft[0], inwards * shaft[1]), angle_error_deg)
        length_mm = max(truth.depth_mm, 1.0)
        entry_mm = tip_mm[0] - length_mm * along[0], tip_mm[1] - length_mm * along[1]
        return Observation(
            capture.stamp_ns,
            found | {"needle_tip": Point(tip_mm), "needle_line": Segment(entry_mm, tip_mm)},
            certainty=Certainty(1.0, sd_mm, error_deg / MEDIAN_OF_NORMAL),
        )
