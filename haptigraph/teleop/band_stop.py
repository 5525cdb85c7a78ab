"""The tremor filter: takes 8 to 12 Hz out of a motion and hardly delays what is slower, the voluntary part.

Knows neither hands nor robots: numbers in, numbers out.
"""

import cmath
import math

import numpy as np
from numpy.typing import NDArray

__all__ = ["LOWEST_RATE_HZ", "TREMOR_HZ", "BandStop"]

TREMOR_HZ = (8.0, 12.0)
ATTENUATION_DB = 20.0
LOWEST_RATE_HZ = 25.0
"""Half of it must lie above the band."""


class BandStop:
    """A causal band-stop filter of fourth order for a pair of numbers.

    Inverse Chebyshev: flat where it passes, and in the whole band never above a given share (Parks and Burrus
    1987, Digital Filter Design). Second-order low-pass prototype, turned into a band-stop, bilinear transform
    with both edges of the band kept in place.

    At 8 and 12 Hz 0.100 of a motion is left (-20 dB), between them never more: 0.097 at 10 Hz with 30
    samples/s. Voluntary motion is delayed by 29 ms at 1 Hz (30 samples/s; 22 ms with 60); up to 2 Hz its size
    changes by less than 1 %. The plain alternative, a Butterworth low-pass of second order at 4 Hz, delays by
    54 ms and leaves 0.16 at 8 Hz. Filters that learn the tremor (Riviere, Rader and Thakor 1998, IEEE Trans.
    Biomed. Eng. 45(7)) delay less, but what they do depends on what was before.

    The filter is linear, so it may be given displacements instead of places: their sum is kept.

    Args:
        rate_hz: Samples per second.

    Raises:
        ValueError: If that is too slow for the band.
    """

    def __init__(self, rate_hz: float) -> None:
        if rate_hz < LOWEST_RATE_HZ:
            raise ValueError(f"the tremor filter needs {LOWEST_RATE_HZ:g} samples/s, found {rate_hz:g}")
        self._forward, self._back = _coefficients(rate_hz)
        self._memory = np.zeros((4, 2))

    def __call__(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Take the next pair, (2,), and return what is left of it (transposed direct form II)."""
        result: NDArray[np.float64] = self._forward[0] * values + self._memory[0]
        later = np.vstack([self._memory[1:], np.zeros(2)])
        self._memory = later + np.outer(self._forward[1:], values) - np.outer(self._back[1:], result)
        return result

    def reset(self) -> None:
        """Forget what came before, as if the hand had always been still."""
        self._memory = np.zeros((4, 2))


def _coefficients(rate_hz: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the numerator's and the denominator's coefficients, (5,) each, in powers of 1/z from 0."""
    low, high = (math.tan(math.pi * edge_hz / rate_hz) for edge_hz in TREMOR_HZ)
    turn = math.asinh(math.sqrt(10 ** (ATTENUATION_DB / 10) - 1)) / 2
    zero = 1j / math.cos(math.pi / 4)
    pole = -1 / cmath.sinh(complex(turn, math.pi / 4))

    def polynomial(root: complex) -> NDArray[np.float64]:
        """Turn a root of the prototype and its conjugate into four of the filter, and these into powers."""
        pairs = [np.roots([1, -(high - low) / each, low * high]) for each in (root, root.conjugate())]
        places = np.concatenate(pairs)
        return np.real(np.poly((1 + places) / (1 - places)))

    forward, back = polynomial(zero), polynomial(pole)
    return forward * back.sum() / forward.sum(), back
