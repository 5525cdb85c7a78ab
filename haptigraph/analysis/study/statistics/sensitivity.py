"""Beside the rank test: are the values normal, what would a t test say, and what could this study have seen.

All estimators are SciPy's and statsmodels'; here they only get names, and an answer where they have none.
"""

import math

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike
from scipy import stats
from statsmodels.stats.power import TTestIndPower, TTestPower

__all__ = [
    "EFFICIENCY", "WANTED", "Normality", "Power", "TTest", "normality", "paired_power", "paired_t",
    "unpaired_power", "welch_t",
]  # fmt: skip

EFFICIENCY = 3 / math.pi  # of rank tests relative to t tests, normal parent (Lehmann 1975; G*Power's A.R.E.)
WANTED = 0.8
LARGEST = 100_000


class Normality(Struct, frozen=True):
    """Shapiro and Wilk's test (1965); NaN where there are fewer than three values, or all are equal."""

    w: float
    p: float


class TTest(Struct, frozen=True):
    """A t test, two-sided, with the 95 % interval of the mean difference (second minus first)."""

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
    """Of the rank test, by that of the t test with n times 3/pi."""

    observed: float
    """At the observed effect; it repeats the p-value in other words (Hoenig and Heisey 2001)."""
    detectable_d: float
    """The smallest standardised effect found with 80 % power."""
    needed: float
    """Participants (per group) for 80 % power at the observed effect; NaN: more than 100 000."""


def normality(values: ArrayLike) -> Normality:
    """Test whether values could be normal.

    Args:
        values: (n,) differences of pairs, or one sample.
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
    said = "paired t, two-sided"
    if len(difference) < 2 or np.ptp(difference) == 0:
        return TTest(math.nan, math.nan, math.nan, mean, math.nan, math.nan, math.nan, f"{said}: no test")
    tested = stats.ttest_rel(second, first)
    low, high = tested.confidence_interval(0.95)
    d = mean / float(difference.std(ddof=1))
    values = (float(tested.statistic), float(tested.df), float(tested.pvalue))
    return TTest(*values, mean, float(low), float(high), d, said)


def welch_t(first: ArrayLike, second: ArrayLike) -> TTest:
    """Welch's t test of independent samples."""
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    said = "Welch t, two-sided"
    few = min(len(first), len(second)) < 2
    mean = math.nan if not len(first) or not len(second) else float(second.mean() - first.mean())
    if few or (np.ptp(first) == 0 and np.ptp(second) == 0):
        return TTest(math.nan, math.nan, math.nan, mean, math.nan, math.nan, math.nan, f"{said}: no test")
    tested = stats.ttest_ind(second, first, equal_var=False)
    low, high = tested.confidence_interval(0.95)
    n, m = len(first), len(second)
    pooled = math.sqrt(((n - 1) * first.var(ddof=1) + (m - 1) * second.var(ddof=1)) / (n + m - 2))
    values = (float(tested.statistic), float(tested.df), float(tested.pvalue))
    return TTest(*values, mean, float(low), float(high), mean / pooled, said)


def paired_power(d: float, pairs: int, alpha: float) -> Power:
    """Return what the signed-rank test of so many pairs can find."""
    return _power(TTestPower(), d, pairs, alpha, {})


def unpaired_power(d: float, first: int, second: int, alpha: float) -> Power:
    """Return what the rank-sum test of so many can find; `needed` is the size of the first group."""
    return _power(TTestIndPower(), d, first, alpha, {"ratio": second / first if first else math.nan})


def _power(of: TTestPower | TTestIndPower, d: float, n: int, alpha: float, more: dict[str, float]) -> Power:
    worth = n * EFFICIENCY
    if worth <= 2 or not math.isfinite(d):
        return Power(math.nan, math.nan, math.nan)
    observed = float(of.power(abs(d), worth, alpha=alpha, **more))
    size = "nobs" if isinstance(of, TTestPower) else "nobs1"
    detectable = _solved(of, {size: worth, "alpha": alpha, "power": WANTED, "effect_size": None, **more})
    at_most = float(of.power(abs(d), LARGEST, alpha=alpha, **more))
    if at_most < WANTED:
        return Power(observed, detectable, math.nan)
    asked = {size: None, "alpha": alpha, "power": WANTED, "effect_size": abs(d), **more}
    needed = _solved(of, asked) if float(of.power(abs(d), 3, alpha=alpha, **more)) < WANTED else 3.0
    return Power(observed, detectable, float(math.ceil(needed / EFFICIENCY)))


def _solved(of: TTestPower | TTestIndPower, asked: dict[str, float | None]) -> float:
    return float(np.ravel(of.solve_power(**asked))[0])
