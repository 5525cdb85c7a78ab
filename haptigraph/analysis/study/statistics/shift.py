"""Hodges-Lehmann estimate of the difference between two conditions, with the interval of the rank test.

Hodges and Lehmann (1963), Annals of Mathematical Statistics 34. The interval holds the differences that the
test does not reject: from the k-th smallest Walsh average, or difference of two observations, to the k-th
largest (Hollander, Wolfe and Chicken 2014, sections 3.3 and 4.3). With ties and zeros, k is that of untied
values: conservative (Noether 1967).
"""

import math
from functools import lru_cache
from typing import Literal

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike
from scipy import stats

from haptigraph.analysis.study.statistics.exact import (
    EXACT_UP_TO,
    Floats,
    quantile,
    rank_sum_distribution,
    signed_rank_distribution,
)
from haptigraph.analysis.study.statistics.rank_tests import differences, equalised

__all__ = ["Shift", "paired_shift", "unpaired_shift"]


class Shift(Struct, frozen=True):
    """The difference, second minus first, in the unit of the values."""

    estimate: float
    low: float
    """Lower limit; NaN where there are too few values."""
    high: float
    level: float
    variant: str


def paired_shift(first: ArrayLike, second: ArrayLike, level: float = 0.95) -> Shift:
    """Return the median of the Walsh averages of all differences, zeros included.

    Args:
        first: (n,) of one condition.
        second: (n,) of the other.
        level: Of confidence.
    """
    difference = differences(first, second)
    pairs = np.triu_indices(len(difference))
    averages = (difference[pairs[0]] + difference[pairs[1]]) / 2
    return _shift(averages, _signed_position(len(difference), level), level, len(difference))


def unpaired_shift(first: ArrayLike, second: ArrayLike, level: float = 0.95) -> Shift:
    """Return the median of all differences between an observation of the second and one of the first.

    Args:
        first: (n,) of one condition.
        second: (m,) of the other.
        level: Of confidence.
    """
    first, second = equalised(first, second)
    between = np.subtract.outer(second, first).ravel()
    n, m = len(first), len(second)
    return _shift(between, _sum_position(n, m, level), level, max(n, m))


def _shift(values: Floats, position: int, level: float, count: int) -> Shift:
    estimate, name = float(np.median(values)), f"Hodges-Lehmann, {100 * level:g} % interval"
    if position < 1:
        return Shift(estimate, math.nan, math.nan, level, "Hodges-Lehmann, no interval (too few values)")
    low, high = np.sort(values)[[position - 1, -position]]
    kind: Literal["exact", "normal approximation"] = (
        "exact" if count <= EXACT_UP_TO else "normal approximation"
    )
    return Shift(estimate, float(low), float(high), level, f"{name} ({kind})")


@lru_cache
def _signed_position(n: int, level: float) -> int:
    if n > EXACT_UP_TO:
        return _normal_position(n * (n + 1) / 4, n * (n + 1) * (2 * n + 1) / 24, level)
    return int(quantile(signed_rank_distribution(np.arange(1.0, n + 1)), (1 - level) / 2))


@lru_cache
def _sum_position(n: int, m: int, level: float) -> int:
    if max(n, m) > EXACT_UP_TO:
        return _normal_position(n * m / 2, n * m * (n + m + 1) / 12, level)
    total = quantile(rank_sum_distribution(np.arange(1.0, n + m + 1), m), (1 - level) / 2)
    return int(total - m * (m + 1) / 2)


def _normal_position(mean: float, variance: float, level: float) -> int:
    return math.ceil(mean - float(stats.norm.ppf((1 + level) / 2)) * math.sqrt(variance) - 0.5)  # continuity
