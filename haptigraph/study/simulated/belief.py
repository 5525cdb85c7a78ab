"""What a simulated operator believes of the needle's angle: a probability for every angle and visual bias.

Turns looks and feelings, each with its noise, into the likeliest angle. People weigh senses by how far they
can be trusted (Ernst and Banks 2002, Nature 415; Koerding and Wolpert 2004, Nature 427). Knows no time.
"""

import numpy as np
from numpy.typing import NDArray

__all__ = ["ANGLES_DEG", "Belief", "seen_angle_deg"]

FloatArray = NDArray[np.float64]

ANGLES_DEG: FloatArray = np.linspace(-40, 40, 401)
"""Signed angles between shaft and line trocar -> target, counter-clockwise positive."""
STEP_DEG = 0.2
BIASES = np.linspace(-2.5, 2.5, 11)  # in deviations
INITIAL_SD_DEG = 15.0
LAPSE = 0.02  # of what is felt, so much could be anything
ROOT_OF_TWO_PI = float(np.sqrt(2 * np.pi))


def seen_angle_deg(theta_deg: FloatArray, depth_mm: float, axis_mm: float) -> FloatArray:
    """Return the angle in the picture between the shaft and the way from its tip to the target.

    At the trocar it is theta itself; the nearer the tip, the larger it gets, so the better it is seen.

    Args:
        theta_deg: Signed, any shape.
        depth_mm: From the pivot to the tip.
        axis_mm: From the pivot to the target.
    """
    theta = np.radians(theta_deg)
    way = np.arctan2(-depth_mm * np.sin(theta), axis_mm - depth_mm * np.cos(theta))
    return np.asarray(np.degrees(theta - way), np.float64)


class Belief:
    """Probability of every angle and of the bias with which it is seen.

    Args:
        bias_deg: Deviation of that bias.
    """

    def __init__(self, bias_deg: float) -> None:
        self._biases_deg = bias_deg * BIASES
        first = np.exp(-0.5 * (ANGLES_DEG / INITIAL_SD_DEG) ** 2)
        self._weights = _normal(np.outer(first, np.exp(-0.5 * BIASES**2)))

    def look(self, seen_deg: float, expected_deg: FloatArray, sd_deg: float) -> None:
        """Take a look.

        Args:
            seen_deg: What was seen.
            expected_deg: What would be, without bias, at each of `ANGLES_DEG`.
            sd_deg: Of a look.
        """
        miss = (seen_deg - expected_deg[:, None] - self._biases_deg) / sd_deg
        self._weights = _normal(self._weights * (np.exp(-0.5 * miss**2) + 1e-6))

    def feel(self, strength: float, expected: FloatArray, share: float) -> None:
        """Take a feeling.

        Args:
            strength: Felt amplitude; 0: nothing.
            expected: Amplitude that training taught for each of `ANGLES_DEG`; 0: nothing.
            share: Deviation of a felt strength, as a share of it.
        """
        is_on = expected > 0
        if strength > 0:
            deviation = np.where(is_on, share * expected, 1.0)
            density = np.exp(-0.5 * ((strength - expected) / deviation) ** 2) / (ROOT_OF_TWO_PI * deviation)
            likely = np.where(is_on, density, 0.0)
        else:
            likely = np.where(is_on, 0.0, 1.0)
        self._weights = _normal(self._weights * ((1 - LAPSE) * likely + LAPSE)[:, None])

    def turned(self, turn_deg: float, sd_deg: float) -> None:
        """Take a turn of the shaft that was asked for, and how uncertain it was."""
        moved = np.array(
            [np.interp(ANGLES_DEG - turn_deg, ANGLES_DEG, column, 0.0, 0.0) for column in self._weights.T]
        )
        width = np.arange(-15, 16) * STEP_DEG
        kernel = np.exp(-0.5 * (width / max(sd_deg, STEP_DEG / 2)) ** 2)
        blurred = [np.convolve(column, kernel / kernel.sum(), mode="same") for column in moved]
        self._weights = _normal(np.array(blurred).T + 1e-12)

    def likeliest_deg(self) -> float:
        """Return the likeliest angle."""
        return float(ANGLES_DEG[int(self._weights.sum(axis=1).argmax())])


def _normal(weights: FloatArray) -> FloatArray:
    return np.asarray(weights / weights.sum(), np.float64)
