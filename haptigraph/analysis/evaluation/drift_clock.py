"""A clock that runs as fast as a drift varies: a Wiener process in its time has quiet hours and steps.

A local-level model of residuals with an own variance for every interval; the variances are estimated by
expectation maximisation, with a prior towards their median and shared among close intervals.
"""

import numpy as np
from msgspec import Struct

from haptigraph.perception.instrument.rotations import Array

__all__ = ["DriftClock", "estimate_clock"]

ROUNDS = 60
WINDOW_H = 0.1
"""Intervals whose middles are closer than this share their variances."""
PRIOR_INTERVALS = 2.0
"""How many intervals the prior is worth."""
CHI2_MEDIAN = 0.455
"""Of one degree of freedom. In most intervals the drift is small against the noise: its variance follows."""
LEAD_H = 2.0
"""For which the clock has run before the first calibration: no reading is negative."""
FLOOR = 1e-4
"""Of the variance of an interval, as a share of that of the noise."""


class DriftClock(Struct, frozen=True, eq=False):
    """Readings of the clock between calibrations; beyond them it runs at its median speed."""

    hours: Array
    readings: Array
    """Variance of the drift since `LEAD_H` before the first, as a share of that of the noise, (n,)."""

    def at(self, hours: Array) -> Array:
        """Return readings, (m,)."""
        readings = np.interp(hours, self.hours, self.readings)
        speed = float(np.median(np.diff(self.readings) / np.maximum(np.diff(self.hours), 1e-9)))
        readings += speed * np.maximum(hours - self.hours[-1], 0)
        return np.asarray(np.maximum(readings - speed * np.maximum(self.hours[0] - hours, 0), 0.0))


def estimate_clock(hours: Array, residuals: Array) -> DriftClock:
    """Estimate the clock.

    Args:
        hours: When each residual was measured, ascending, (n,).
        residuals: Drift and noise, (n,).
    """
    steps_h = np.maximum(np.diff(hours), 1e-9)
    noise = max(float(np.median(np.diff(residuals) ** 2)) / (2 * CHI2_MEDIAN), 1e-18)
    variances = np.full(len(steps_h), 0.3 * noise)
    middles = (hours[1:] + hours[:-1]) / 2
    first = np.searchsorted(middles, middles - WINDOW_H)
    last = np.searchsorted(middles, middles + WINDOW_H, side="right")
    for _ in range(ROUNDS):
        squared_steps = _smooth(residuals, variances, noise)
        sums = np.concatenate([[0.0], np.cumsum(squared_steps)])
        spans = np.concatenate([[0.0], np.cumsum(steps_h)])
        local, span_h = sums[last] - sums[first], spans[last] - spans[first]
        usual = float(np.median(local / span_h))
        prior_h = PRIOR_INTERVALS * span_h / (last - first)
        speeds = (local + usual * prior_h) / (span_h + prior_h)
        variances = np.maximum(speeds * steps_h, FLOOR * noise)
    readings = np.concatenate([[0.0], np.cumsum(variances / noise)])
    return DriftClock(hours, readings + LEAD_H * float(np.median(variances / noise / steps_h)))


def _smooth(residuals: Array, variances: Array, noise: float) -> Array:
    """Return the expected squares of the drift's steps, (n - 1,), by Kalman smoothing."""
    n = len(residuals)
    levels, spreads = np.empty(n), np.empty(n)
    levels[0], spreads[0] = residuals[0], noise
    for i in range(1, n):
        predicted = spreads[i - 1] + variances[i - 1]
        gain = predicted / (predicted + noise)
        levels[i] = levels[i - 1] + gain * (residuals[i] - levels[i - 1])
        spreads[i] = predicted * noise / (predicted + noise)
    squared_steps = np.empty(n - 1)
    for i in range(n - 2, -1, -1):
        predicted = spreads[i] + variances[i]
        back = spreads[i] / predicted
        level = levels[i] + back * (levels[i + 1] - levels[i])
        spread = spreads[i] + back**2 * (spreads[i + 1] - predicted)
        shared = back * spreads[i + 1]
        squared_steps[i] = (levels[i + 1] - level) ** 2 + spreads[i + 1] + spread - 2 * shared
        levels[i], spreads[i] = level, spread
    return squared_steps
