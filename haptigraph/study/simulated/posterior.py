"""A simulated operator's posterior belief about the needle's angle, over angles and visual bias.

Fuses noisy visual and haptic cues into a maximum a posteriori angle. People weight cues by their reliability
(Ernst and Banks 2002, Nature 415; Koerding and Wolpert 2004, Nature 427).
"""

import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["ANGLES_DEG", "AnglePosterior", "FloatArray", "visual_angle_deg"]

FloatArray = NDArray[np.float64]

ANGLES_DEG: FloatArray = np.linspace(-40, 40, 401)
"""Signed angles between shaft and line trocar -> target, counter-clockwise positive."""
STEP_DEG = 0.2
OFFSETS_DEG = STEP_DEG * np.arange(-16, 17)  # of a turn from the intended one
BIASES = np.linspace(-2.5, 2.5, 11)  # in standard deviations
PRIOR_SD_DEG = 15.0
LAPSE_RATE = 0.02  # share of haptic cues that carry no information
ROOT_OF_TWO_PI = float(np.sqrt(2 * np.pi))


def visual_angle_deg(theta_deg: FloatArray, depth_mm: float, axis_mm: float) -> FloatArray:
    """Return the angle in the image between the shaft and the line from tip to target.

    At the trocar it equals theta; it grows, and becomes easier to see, as the tip approaches the target.

    Args:
        theta_deg: Signed, any shape.
        depth_mm: From the RCM to the tip.
        axis_mm: From the RCM to the target.
    """
    theta = np.radians(theta_deg)
    bearing = np.arctan2(-depth_mm * np.sin(theta), axis_mm - depth_mm * np.cos(theta))
    return np.asarray(np.degrees(theta - bearing), np.float64)


class AnglePosterior:
    """Joint probability of the needle's angle and of the bias with which it is seen.

    Args:
        bias_sd_deg: Standard deviation of that bias.
    """

    def __init__(self, bias_sd_deg: float) -> None:
        self._biases_deg = bias_sd_deg * BIASES[:, None]
        prior = np.exp(-0.5 * (ANGLES_DEG / PRIOR_SD_DEG) ** 2)
        self._weights = _normalised(np.outer(np.exp(-0.5 * BIASES**2), prior))

    def add_visual_cue(self, seen_deg: float, expected_deg: FloatArray, sd_deg: float) -> None:
        """Update with one visual estimate.

        Args:
            seen_deg: The visual estimate.
            expected_deg: Unbiased expectation at each of `ANGLES_DEG`.
            sd_deg: Standard deviation of the estimate.
        """
        error = (seen_deg - expected_deg - self._biases_deg) / sd_deg
        self._weights = _normalised(self._weights * (np.exp(-0.5 * error**2) + 1e-6))

    def add_haptic_cue(self, amplitude: float, expected: FloatArray, weber_fraction: float) -> None:
        """Update with one haptic percept.

        Args:
            amplitude: Perceived amplitude; 0: none.
            expected: Trained amplitude at each of `ANGLES_DEG`; 0: none.
            weber_fraction: Standard deviation of a perceived amplitude, relative to it.
        """
        is_on = expected > 0
        if amplitude > 0:
            sd = np.where(is_on, weber_fraction * expected, 1.0)
            density = np.exp(-0.5 * ((amplitude - expected) / sd) ** 2) / (ROOT_OF_TWO_PI * sd)
            likelihood = np.where(is_on, density, 0.0)
        else:
            likelihood = np.where(is_on, 0.0, 1.0)
        self._weights = _normalised(self._weights * ((1 - LAPSE_RATE) * likelihood + LAPSE_RATE))

    def predict(self, turn_deg: float, sd_deg: float) -> None:
        """Propagate an intended turn of the shaft with its standard deviation."""
        noise = np.exp(-0.5 * (OFFSETS_DEG / max(sd_deg, STEP_DEG / 2)) ** 2)
        noise[[0, -1]] = 0.0  # so that it ends between two angles, wherever the turn ends
        reach = min(len(OFFSETS_DEG) // 2 + math.ceil(abs(turn_deg) / STEP_DEG), len(ANGLES_DEG) // 2)
        turns_deg = STEP_DEG * np.arange(-reach, reach + 1)
        kernel = np.interp(turns_deg - turn_deg, OFFSETS_DEG, noise / noise.sum(), 0.0, 0.0)
        moved = cv2.filter2D(self._weights, -1, kernel[None, ::-1], borderType=cv2.BORDER_CONSTANT)
        self._weights = _normalised(moved + 1e-12)

    def most_probable_deg(self) -> float:
        """Return the angle with the highest marginal probability."""
        return float(ANGLES_DEG[int(self._weights.sum(axis=0).argmax())])


def _normalised(weights: NDArray[np.floating[Any]]) -> FloatArray:
    return np.asarray(weights / weights.sum(), np.float64)
