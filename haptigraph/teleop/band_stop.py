"""The tremor filter: removes 8 to 12 Hz from a motion and hardly delays the slower, voluntary part."""

import cmath
import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["MIN_RATE_HZ", "TREMOR_HZ", "BandStop"]

TREMOR_HZ = (8.0, 12.0)
ATTENUATION_DB = 20.0
MIN_RATE_HZ = 25.0
"""Half of it, the Nyquist frequency, must be above the band."""


class BandStop:
    """A causal fourth-order band-stop filter for the axes of a motion.

    Inverse Chebyshev: monotonic passband, bounded gain in the whole stopband (Parks and Burrus 1987, Digital
    Filter Design). Second-order low-pass prototype, band-stop transform, bilinear transform with both band
    edges prewarped.

    The gain is 0.100 (-20 dB) at 8 and 12 Hz and lower between them: 0.097 at 10 Hz with 30 samples/s.
    Voluntary motion is delayed by 29 ms at 1 Hz (30 samples/s; 22 ms with 60); up to 2 Hz its amplitude
    changes by less than 1 %. A second-order Butterworth low-pass at 4 Hz delays by 54 ms and has a gain of
    0.16 at 8 Hz. Adaptive filters (Riviere, Rader and Thakor 1998, IEEE Trans. Biomed. Eng. 45(7)) delay
    less, but their effect depends on the history of the signal.

    The filter is linear, so its input may be displacements instead of positions; it preserves their sum.

    Args:
        rate_hz: Samples per second.
        axes: Numbers per sample.

    Raises:
        ValueError: If the rate is too low for the band.
    """

    def __init__(self, rate_hz: float, axes: int = 2) -> None:
        if rate_hz < MIN_RATE_HZ:
            raise ValueError(f"the tremor filter needs at least {MIN_RATE_HZ:g} samples/s, found {rate_hz:g}")
        self._forward, self._back = _coefficients(rate_hz)
        self._state = np.zeros((4, axes))

    def __call__(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Filter the next sample, (axes,), in transposed direct form II."""
        result: NDArray[np.float64] = self._forward[0] * values + self._state[0]
        shifted = np.zeros_like(self._state)
        shifted[:-1] = self._state[1:]
        self._state = shifted + np.outer(self._forward[1:], values) - np.outer(self._back[1:], result)
        return result

    def reset(self) -> None:
        """Clear the state of the filter."""
        self._state.fill(0.0)


def _coefficients(rate_hz: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the coefficients of numerator and denominator, (5,) each, in powers of 1/z from 0."""
    low, high = (math.tan(math.pi * edge_hz / rate_hz) for edge_hz in TREMOR_HZ)
    mu = math.asinh(math.sqrt(10 ** (ATTENUATION_DB / 10) - 1)) / 2
    zero = 1j / math.cos(math.pi / 4)
    pole = -1 / cmath.sinh(complex(mu, math.pi / 4))

    def polynomial(root: complex) -> NDArray[np.float64]:
        """Transform a root of the prototype and its conjugate; return the polynomial of the results."""
        pairs = [np.roots([1, -(high - low) / each, low * high]) for each in (root, root.conjugate())]
        roots = np.concatenate(pairs)
        return np.real(np.poly((1 + roots) / (1 - roots)))

    forward, back = polynomial(zero), polynomial(pole)
    return forward * back.sum() / forward.sum(), back
