"""Sensitivity analysis of the rank test: normality, t test, and power.

Wraps the estimators of SciPy and statsmodels, and defines the result where they have none.
"""

import math

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike
from scipy import stats
from statsmodels.stats.power import TTestIndPower, TTestPower

__all__ = [
    "EFFICIENCY", "TARGET_POWER", "Normality", "Power", "TTest", "normality", "paired_power", "paired_t",
    "unpaired_power", "welch_t",
]  # fmt: skip

EFFICIENCY = 3 / math.pi  # of rank tests relative to t tests, normal data (Lehmann 1975; G*Power's A.R.E.)
TARGET_POWER = 0.8
MAX_N = 100_000


class Normality(Struct, frozen=True):
    """The Shapiro-Wilk test (1965); NaN with fewer than three values, or if all are equal."""

    w: float
    p: float


class TTest(Struct, frozen=True):
    """A t test, two-sided, with the 95 % interval of the mean difference (second minus first).

    A study's report leaves the interval out: with few skewed pairs it covers 90 %
    (docs/explanation/study_report.md).
    """

    t: float
    df: float
    p: float
    difference: float
    low: float
    high: float
    d: float
    """Standardised: paired d_z = mean / SD of differences; otherwise by the pooled SD."""
    variant: str


class Power(Struct, frozen=True):
    """Power of the rank test, approximated by that of the t test with n times 3/pi."""

    observed: float
    """At the observed effect; a function of the p-value (Hoenig and Heisey 2001)."""
    detectable_d: float
    """The smallest standardised effect that is detected with 80 % power."""
    needed: float
    """Sample size (per group) for 80 % power at the observed effect; NaN: more than 100 000."""


def normality(values: ArrayLike) -> Normality:
    """Test the normality of values.

    Args:
        values: (n,) paired differences, or one sample.
    """
    values = np.asarray(values, np.float64)
    if len(values) < 3 or np.ptp(values) == 0:
        return Normality(math.nan, math.nan)
    tested = stats.shapiro(values)
    return Normality(float(tested.statistic), float(tested.pvalue))


def paired_t(first: ArrayLike, second: ArrayLike) -> TTest:
    """Student's t test of paired values."""
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    difference = second - first
    mean = float(difference.mean()) if len(difference) else math.nan
    variant = "paired t, two-sided"
    if len(difference) < 2 or np.ptp(difference) == 0:
        return TTest(math.nan, math.nan, math.nan, mean, math.nan, math.nan, math.nan, f"{variant}: no test")
    tested = stats.ttest_rel(second, first)
    low, high = tested.confidence_interval(0.95)
    d = mean / float(difference.std(ddof=1))
    values = (float(tested.statistic), float(tested.df), float(tested.pvalue))
    return TTest(*values, mean, float(low), float(high), d, variant)


def welch_t(first: ArrayLike, second: ArrayLike) -> TTest:
    """Welch's t test of independent samples."""
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    variant = "Welch t, two-sided"
    few = min(len(first), len(second)) < 2
    mean = math.nan if not len(first) or not len(second) else float(second.mean() - first.mean())
    if few or (np.ptp(first) == 0 and np.ptp(second) == 0):
        return TTest(math.nan, math.nan, math.nan, mean, math.nan, math.nan, math.nan, f"{variant}: no test")
    tested = stats.ttest_ind(second, first, equal_var=False)
    low, high = tested.confidence_interval(0.95)
    n, m = len(first), len(second)
    pooled = math.sqrt(((n - 1) * first.var(ddof=1) + (m - 1) * second.var(ddof=1)) / (n + m - 2))
    values = (float(tested.statistic), float(tested.df), float(tested.pvalue))
    return TTest(*values, mean, float(low), float(high), mean / pooled, variant)


def paired_power(d: float, pairs: int, alpha: float) -> Power:
    """Return the power of the signed-rank test."""
    return _power(TTestPower(), d, pairs, alpha, {})


def unpaired_power(d: float, first: int, second: int, alpha: float) -> Power:
    """Return the power of the rank-sum test; `needed` is the size of the first group."""
    return _power(TTestIndPower(), d, first, alpha, {"ratio": second / first if first else math.nan})


def _power(test: TTestPower | TTestIndPower, d: float, n: int, alpha: float, more: dict[str, float]) -> Power:
    effective_n = n * EFFICIENCY
    if effective_n <= 2 or not math.isfinite(d):
        return Power(math.nan, math.nan, math.nan)
    observed = float(test.power(abs(d), effective_n, alpha=alpha, **more))
    size = "nobs" if isinstance(test, TTestPower) else "nobs1"
    known = {"alpha": alpha, "power": TARGET_POWER, **more}
    detectable = _solved(test, {size: effective_n, "effect_size": None, **known})
    if float(test.power(abs(d), MAX_N, alpha=alpha, **more)) < TARGET_POWER:
        return Power(observed, detectable, math.nan)
    needed = 3.0
    if float(test.power(abs(d), needed, alpha=alpha, **more)) < TARGET_POWER:
        needed = _solved(test, {size: None, "effect_size": abs(d), **known})
    return Power(observed, detectable, float(math.ceil(needed / EFFICIENCY)))


def _solved(test: TTestPower | TTestIndPower, known: dict[str, float | None]) -> float:
    return float(np.ravel(test.solve_power(**known))[0])
