"""How something moved, from evenly sampled places: length, smoothness, tremor. Arrays in, numbers out.

Knows no recording. Of each measure the formula and its source stand in its docstring.
"""

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "SMOOTH_HZ",
    "TREMOR_HZ",
    "band_power",
    "log_dimensionless_jerk",
    "low_passed",
    "path_length",
    "sparc",
    "speed",
]

Floats = NDArray[np.float64]
SMOOTH_HZ = 5.0
"""Willed motion in such tasks lies below; noise of a tracked tip, and tremor, above."""
TREMOR_HZ = (8.0, 12.0)
"""Band of surgeons' physiological tremor (PMC3989364)."""
SPARC_HZ, SPARC_LEAST, SPARC_PADDING = 10.0, 0.05, 4


def low_passed(samples: Floats, rate_hz: float, cutoff_hz: float = SMOOTH_HZ) -> Floats:
    """Return samples without what is faster than a cut-off, not delayed.

    A Butterworth filter of second order run forwards and backwards, done in the frequency domain:
    gain 1 / (1 + (f / f_c)^4), which is 1/2 at the cut-off. The ends are mirrored through their points.

    Args:
        samples: (n,) or (n, k), n at least 2.
        rate_hz: Of the samples.
        cutoff_hz: The cut-off f_c.
    """
    before, after = 2 * samples[0] - samples[:0:-1], 2 * samples[-1] - samples[-2::-1]
    padded = np.concatenate([before, samples, after])
    frequency_hz = np.fft.rfftfreq(len(padded), 1 / rate_hz)
    gain = 1 / (1 + (frequency_hz / cutoff_hz) ** 4)
    spectrum = np.fft.rfft(padded, axis=0) * gain.reshape(-1, *[1] * (samples.ndim - 1))
    smooth: Floats = np.fft.irfft(spectrum, len(padded), axis=0)
    return smooth[len(before) : len(before) + len(samples)]


def path_length(places: Floats) -> float:
    """Return the length of a path, sum of |x_i+1 - x_i|, in the unit of its places (n, 2)."""
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


def speed(places: Floats, rate_hz: float) -> Floats:
    """Return the speed |dx/dt| (n,) at places (n, 2), by central differences."""
    moved: Floats = np.gradient(places, 1 / rate_hz, axis=0)
    speeds: Floats = np.linalg.norm(moved, axis=1)
    return speeds


def sparc(speeds: Floats, rate_hz: float) -> float | None:
    """Return the spectral arc length of a movement; None if there was none.

    SPARC = -integral_0^w_c sqrt((1 / w_c)^2 + (dV/dw)^2) dw, V the magnitude of the speed's spectrum over its
    value at 0, w_c the last frequency up to 10 Hz at which V is at least 0.05. The longer and the more broken
    the movement, the more negative. S. Balasubramanian et al.: On the analysis of movement smoothness,
    J. NeuroEngineering Rehabil. 12:112, 2015; padding as in the authors' program.

    Args:
        speeds: (n,)
        rate_hz: Of the samples.
    """
    if len(speeds) < 2 or not np.any(speeds):
        return None
    padded = 2 ** (int(np.ceil(np.log2(len(speeds)))) + SPARC_PADDING)
    magnitude = np.abs(np.fft.rfft(speeds, padded))
    magnitude = magnitude / magnitude.max()
    frequency_hz = np.fft.rfftfreq(padded, 1 / rate_hz)
    within = frequency_hz <= SPARC_HZ
    last = int(np.flatnonzero(within & (magnitude >= SPARC_LEAST))[-1])
    if last == 0:
        return None
    steps = np.diff(frequency_hz[: last + 1]) / frequency_hz[last]
    return -float(np.hypot(steps, np.diff(magnitude[: last + 1])).sum())


def log_dimensionless_jerk(speeds: Floats, rate_hz: float) -> float | None:
    """Return the log dimensionless jerk of a movement; None if there was none.

    LDLJ = -ln((T^3 / v_peak^2) integral |d^2v/dt^2|^2 dt), T the duration, v the speed. Balasubramanian et
    al. 2015, as `sparc`; second differences as in the authors' program.

    Args:
        speeds: (n,)
        rate_hz: Of the samples.
    """
    if len(speeds) < 3 or not np.any(speeds):
        return None
    duration_s = len(speeds) / rate_hz
    jerk = np.diff(speeds, 2) * rate_hz**2
    total = float((jerk**2).sum() / rate_hz * duration_s**3 / speeds.max() ** 2)
    return -float(np.log(total)) if total > 0 else None


def band_power(places: Floats, rate_hz: float, band_hz: tuple[float, float] = TREMOR_HZ) -> float | None:
    """Return the power of a motion in a band: its variance there, both axes together.

    Welch's method: windows of 1 s (Hann) that overlap by half, a straight line taken out of each, one-sided
    power spectral density, summed over the band with its ends. A sine of amplitude A in the band gives
    A^2 / 2. P. D. Welch, IEEE Trans. Audio Electroacoust. 15(2), 1967.

    Args:
        places: (n, 2).
        rate_hz: Of the samples.
        band_hz: Lowest and highest frequency.

    Returns:
        In the places' unit squared; None if the samples are too few or too slow for the band.
    """
    length = round(rate_hz)
    if length < 2 * band_hz[1] or len(places) < length:
        return None
    window = np.hanning(length + 1)[:-1]
    time = np.arange(length) - (length - 1) / 2
    powers = []
    for start in range(0, len(places) - length + 1, length // 2):
        piece = places[start : start + length] - places[start : start + length].mean(axis=0)
        piece = piece - np.outer(time, time @ piece) / (time @ time)
        powers.append(np.abs(np.fft.rfft(piece * window[:, None], axis=0)) ** 2)
    frequency_hz = np.fft.rfftfreq(length, 1 / rate_hz)
    inside = (frequency_hz >= band_hz[0]) & (frequency_hz <= band_hz[1])
    per_bin = 2 * np.mean(powers, axis=0) / (length * (window**2).sum())
    return float(per_bin[inside].sum())
