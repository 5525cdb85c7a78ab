"""The needle as the simulator knows it, with the tracker's measured noise: a perceiver for simulated studies.

Stands in for perception where thousands of trials are played without drawing an image, and only there: it is
in no registry, and results made with it say so. Turns the truth of a capture into an observation. What the
tracker does beyond noise (shadows, lost needles, a needle that is found late) is not simulated.
"""

import math

import numpy as np

from haptigraph.geometry import Geometry, Point, Segment, rotate, subtract, unit
from haptigraph.messages import Capture, Observation
from haptigraph.registration.camera import Registration

__all__ = ["GroundTruthPerceiver"]

# docs/accuracy.md, perceiver `tracker`, 66 simulated scenes.
NOISE_DEPTHS_MM = (1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 18.0)
NOISE_DEG = (0.0258, 0.0242, 0.00835, 0.0385, 0.00897, 0.00595, 0.00325)  # from image to image
ERROR_DEG = ((3.0, 0.0518), (math.inf, 0.0219))  # median of the error up to a depth
TIP_ERROR_MM = 0.416 / 20  # median
MEDIAN_OF_NORMAL, MEDIAN_OF_RAYLEIGH = 0.6745, 1.1774  # over their deviation
SHALLOWEST_MM = 1.0  # nearer to the pivot the tip is in the wall, or hardly out of it


class GroundTruthPerceiver:
    """Report the true needle, a little wrong.

    The angle has an error that stays and noise from image to image, both as large as the tracker's, by depth.
    The tip has noise as large as the tracker's whole error, so that it trembles more than the tracker's.

    Args:
        registration: Where the anatomy lies.
        seed: Of the noise.
    """

    def __init__(self, registration: Registration, seed: tuple[int, ...]) -> None:
        self._registration, self._seed = registration, seed
        self.reset()

    def reset(self) -> None:
        """Begin the noise again."""
        self._rng = np.random.default_rng(self._seed)
        self._offset = float(self._rng.standard_normal())

    def __call__(self, capture: Capture) -> Observation:
        """Report what a capture's truth says; nothing where the tip cannot be seen."""
        truth, found = capture.truth, dict[str, Geometry](self._registration.anatomy)
        noise = self._rng.standard_normal(3)
        if truth is None or not truth.visible or abs(truth.depth_mm) < SHALLOWEST_MM:
            return Observation(capture.stamp_ns, found)
        trocar_mm = self._registration.trocar.at_mm
        error_deg = next(error for depth_mm, error in ERROR_DEG if truth.depth_mm <= depth_mm)
        wrong_deg = self._offset * error_deg / MEDIAN_OF_NORMAL
        wrong_deg += float(noise[0]) * float(np.interp(truth.depth_mm, NOISE_DEPTHS_MM, NOISE_DEG))
        spread_mm = TIP_ERROR_MM / MEDIAN_OF_RAYLEIGH
        x, y = truth.tip_mm
        tip_mm = x + spread_mm * float(noise[1]), y + spread_mm * float(noise[2])
        inwards = math.copysign(1, truth.depth_mm)
        shaft = unit(subtract(truth.tip_mm, trocar_mm))
        along = rotate((inwards * shaft[0], inwards * shaft[1]), wrong_deg)
        length_mm = max(truth.depth_mm, 1.0)
        entry_mm = tip_mm[0] - length_mm * along[0], tip_mm[1] - length_mm * along[1]
        return Observation(
            capture.stamp_ns,
            found | {"needle_tip": Point(tip_mm), "needle_line": Segment(entry_mm, tip_mm)},
        )
