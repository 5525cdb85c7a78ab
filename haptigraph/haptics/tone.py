"""Turn amplitude and frequency into the samples of a sine, with short ramps to avoid clicks.

Shared by the sound card and the sound file; its time is counted in samples.
"""

import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["RATE_HZ", "Tone"]

RATE_HZ = 48_000
RAMP_S = 0.005
DEFAULT_HZ = 160.0
SILENCE = 1e-6  # exceeds the rounding error at the end of a ramp


class Tone:
    """A sine whose amplitude follows the last setting, and that falls silent by itself.

    Args:
        holds_ms: Time after which it falls silent unless it is set again.
    """

    def __init__(self, holds_ms: float) -> None:
        self._holds = round(holds_ms / 1e3 * RATE_HZ)
        self._left = 0
        self._amplitude, self._target, self._frequency_hz, self._turns = 0.0, 0.0, DEFAULT_HZ, 0.0

    def set(self, amplitude: float, frequency_hz: float) -> None:
        """Play from the next sample on; at 160 Hz if the frequency is 0."""
        if amplitude:
            self._frequency_hz = frequency_hz or DEFAULT_HZ
        self._target, self._left = amplitude, self._holds

    def samples(self, count: int) -> NDArray[np.float32]:
        """Return the next samples in [-1, 1], (count,)."""
        sounding = min(self._left, count)
        self._left -= sounding
        return np.concatenate([self._part(sounding, self._target), self._part(count - sounding, 0.0)])

    def _part(self, count: int, target: float) -> NDArray[np.float32]:
        if not count or not (target or self._amplitude):
            return np.zeros(count, np.float32)
        steps = np.arange(1, count + 1) / (RAMP_S * RATE_HZ)
        down = target < self._amplitude
        envelope = (
            np.maximum(self._amplitude - steps, target)
            if down
            else np.minimum(self._amplitude + steps, target)
        )
        turns = self._turns + np.arange(1, count + 1) * (self._frequency_hz / RATE_HZ)
        self._amplitude = float(envelope[-1]) if envelope[-1] > SILENCE else 0.0
        self._turns = float(turns[-1] % 1.0) if self._amplitude else 0.0
        samples: NDArray[np.float32] = (envelope * np.sin(2 * math.pi * turns)).astype(np.float32)
        return samples
