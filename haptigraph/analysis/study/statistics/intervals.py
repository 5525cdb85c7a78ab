"""Intervals of a rank-biserial correlation: exact over a tilted family, and by Fisher's transformation.

The family multiplies the null probability of a rank sum W by exp(beta W) (exponential tilting: Efron 1981,
Canadian Journal of Statistics 9, section 11; of two samples it is Mallows's model of rankings, 1957,
Biometrika 44). Each beta has an expected correlation. As with Clopper and Pearson (1934), the interval holds
those under which neither tail from the observed sum has a probability below 2.5 %. It excludes 0 exactly
where the exact test, its smaller tail doubled, has p < 0.05.

The family fixes the variance at each correlation. From eleven values on, the data's own variance is known
well enough to widen an interval that is too narrow for them: that of a U statistic (Hoeffding 1948, Annals of
Mathematical Statistics 19; of two samples Cliff 1996, Multivariate Behavioral Research 31).
"""

import math
from collections.abc import Callable

import numpy as np
from scipy import stats
from scipy.optimize import brentq

from haptigraph.analysis.study.statistics.exact import Floats

__all__ = ["WIDENED_ABOVE", "Limits", "fisher_interval", "tilted_interval", "widest"]

Limits = tuple[float, float]
WIDENED_ABOVE = 10  # pairs, or values in the smaller sample
STEEPEST = 20.0  # exp(20) between neighbouring sums: all probability lies at one end


def tilted_interval(
    probabilities: Floats, total: float, center: float, half_range: float, level: float = 0.95
) -> Limits:
    """Return the limits of (E[W] - center) / half_range, where W is a rank sum.

    Args:
        probabilities: Null distribution of W; index k is the sum k / 2.
        total: The observed W.
        center: W without an effect.
        half_range: From the center to the largest W without ties.
        level: Of confidence.

    Returns:
        NaN, NaN where even the most extreme W would not be significant: no such interval excludes anything.
    """
    sums, tail = np.flatnonzero(probabilities), (1 - level) / 2
    null = np.log(probabilities[sums])
    if math.exp(max(null[0], null[-1])) > tail:
        return math.nan, math.nan
    at = int(np.searchsorted(sums, round(2 * total)))
    correlations = (sums / 2 - center) / half_range

    def tilted(beta: float) -> Floats:
        logs = null + beta * (sums - sums[0])
        weights = np.exp(logs - logs.max())
        return np.asarray(weights / weights.sum())

    def limit(excess: Callable[[float], float]) -> float:
        return float(tilted(brentq(excess, -STEEPEST, STEEPEST, xtol=1e-10)) @ correlations)

    low = limit(lambda beta: tilted(beta)[at:].sum() - tail) if at else -1.0
    high = limit(lambda beta: tilted(beta)[: at + 1].sum() - tail) if at < len(sums) - 1 else 1.0
    return low, high


def fisher_interval(r: float, *influences: Floats, level: float = 0.95) -> Limits:
    """Return r's limits on the scale of Fisher's z, by Student's t; NaN, NaN at r = 1 and -1.

    Args:
        r: The correlation.
        influences: Of each sample, (n,): twice the mean sign of each difference's averages with the others
            (paired), or the mean sign of each observation's differences to the other sample.
        level: Of confidence.
    """
    if abs(r) > 1 - 1e-9:
        return math.nan, math.nan
    error = math.sqrt(sum(float(np.var(each, ddof=1)) / len(each) for each in influences)) / (1 - r * r)
    half = float(stats.t.ppf((1 + level) / 2, sum(len(each) - 1 for each in influences))) * error
    return math.tanh(math.atanh(r) - half), math.tanh(math.atanh(r) + half)


def widest(one: Limits, other: Limits) -> Limits:
    """Return the smaller lower and the larger upper limit; those of `one` where the other has none."""
    if math.isnan(other[0]):
        return one
    return min(one[0], other[0]), max(one[1], other[1])
