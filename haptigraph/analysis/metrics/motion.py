"""Motion measures of evenly sampled positions: path length, smoothness, tremor.

Docstrings state the formula of each measure and its source.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch

__all__ = [
    "MAX_SPARC_HZ",
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
"""Cut-off: voluntary motion in such tasks is slower; tremor and the noise of a tracked tip are faster."""
TREMOR_HZ = (8.0, 12.0)
"""Band of surgeons' physiological tremor (PMC3989364)."""
TREMOR_WINDOW_S = 2.0
MAX_SPARC_HZ, MIN_SPARC_MAGNITUDE, SPARC_PADDING = 10.0, 0.05, 4


def low_passed(samples: Floats, rate_hz: float, cutoff_hz: float = SMOOTH_HZ) -> Floats:
    """Low-pass filter samples without delay.

    A second-order Butterworth filter applied forwards and backwards, computed in the frequency domain:
    gain 1 / (1 + (f / f_c)^4), which is 1/2 at the cut-off. Padding is the point reflection of the samples
    about each end.

    Args:
        samples: (n,) or (n, k), n at least 2.
        rate_hz: Sampling rate.
        cutoff_hz: Cut-off frequency f_c.
    """
    before, after = 2 * samples[0] - samples[:0:-1], 2 * samples[-1] - samples[-2::-1]
    padded = np.concatenate([before, samples, after])
    frequency_hz = np.fft.rfftfreq(len(padded), 1 / rate_hz)
    gain = 1 / (1 + (frequency_hz / cutoff_hz) ** 4)
    spectrum = np.fft.rfft(padded, axis=0) * gain.reshape(-1, *[1] * (samples.ndim - 1))
    smooth: Floats = np.fft.irfft(spectrum, len(padded), axis=0)
    return smooth[len(before) : len(before) + len(samples)]


def path_length(positions: Floats) -> float:
    """Return the length of the path through positions (n, 2), in their unit."""
    return float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())


def speed(positions: Floats, rate_hz: float) -> Floats:
    """Return the speed (n,) at positions (n, 2), by central differences."""
    velocity: Floats = np.gradient(positions, 1 / rate_hz, axis=0)
    speeds: Floats = np.linalg.norm(velocity, axis=1)
    return speeds


def sparc(speeds: Floats, rate_hz: float) -> float | None:
    """Return the spectral arc length of a movement; None if nothing moved.

    SPARC = -integral_0^w_c sqrt((1 / w_c)^2 + (dV/dw)^2) dw, V the magnitude of the speed's spectrum over its
    value at 0, w_c the last frequency up to 10 Hz at which V is at least 0.05. The longer and the more
    intermittent the movement, the more negative. S. Balasubramanian et al.: On the analysis of movement
    smoothness, J. NeuroEngineering Rehabil. 12:112, 2015; padding as in the authors' program.

    Args:
        speeds: (n,)
        rate_hz: Sampling rate.
    """
    if len(speeds) < 2 or not np.any(speeds):
        return None
    padded = 2 ** (int(np.ceil(np.log2(len(speeds)))) + SPARC_PADDING)
    magnitude = np.abs(np.fft.rfft(speeds, padded))
    magnitude = magnitude / magnitude.max()
    frequency_hz = np.fft.rfftfreq(padded, 1 / rate_hz)
    within = frequency_hz <= MAX_SPARC_HZ
    last = int(np.flatnonzero(within & (magnitude >= MIN_SPARC_MAGNITUDE))[-1])
    if last == 0:
        return None
    steps = np.diff(frequency_hz[: last + 1]) / frequency_hz[last]
    return -float(np.hypot(steps, np.diff(magnitude[: last + 1])).sum())


def log_dimensionless_jerk(speeds: Floats, rate_hz: float) -> float | None:
    """Return the log dimensionless jerk of a movement; None if nothing moved.

    LDLJ = -ln((T^3 / v_peak^2) integral (d^2v/dt^2)^2 dt), T the duration, v the speed. Balasubramanian et
    al. 2015, as `sparc`; second differences as in the authors' program.

    Args:
        speeds: (n,)
        rate_hz: Sampling rate.
    """
    if len(speeds) < 3 or not np.any(speeds):
        return None
    duration_s = len(speeds) / rate_hz
    jerk = np.diff(speeds, 2) * rate_hz**2
    total = float((jerk**2).sum() / rate_hz * duration_s**3 / speeds.max() ** 2)
    return -float(np.log(total)) if total > 0 else None


def band_power(positions: Floats, rate_hz: float, band_hz: tuple[float, float] = TREMOR_HZ) -> float | None:
    """Return the power of a motion in a frequency band: its variance there, summed over both axes.

    Welch's method (P. D. Welch, IEEE Trans. Audio Electroacoust. 15(2), 1967): Hann windows of 2 s, linearly
    detrended, one-sided power spectral density. It is summed over the band and 1.5 bins, 0.75 Hz, on either
    side. Windows overlap by 75 %, so that all samples but the first and last have the same weight.

    A sine of amplitude A anywhere in the band, ends included, gives A^2 / 2 within 1 % from 26 samples/s on;
    below, where 12 Hz is almost half the rate, within 10 % over 6 s. The ends are soft: half of a sine's
    power at 7.25 and 12.75 Hz counts, and white noise counts as in a band of 5.5 Hz.

    Args:
        positions: (n, 2), evenly sampled.
        rate_hz: Sampling rate.
        band_hz: Lowest and highest frequency.

    Returns:
        In the positions' unit squared; None if there are fewer samples than in a window, or the sampling rate
        is less than a bin above twice the highest frequency.
    """
    length = round(TREMOR_WINDOW_S * rate_hz)
    bin_hz = rate_hz / length if length else np.inf
    if rate_hz < 2 * band_hz[1] + 0.9 * bin_hz or len(positions) < length:
        return None
    frequency_hz, density = welch(
        positions, rate_hz, nperseg=length, noverlap=length - length // 4, detrend="linear", axis=0
    )
    is_in_band = (frequency_hz > band_hz[0] - 1.5 * bin_hz) & (frequency_hz < band_hz[1] + 1.5 * bin_hz)
    return float(density[is_in_band].sum() * bin_hz)
