"""Equivalence of two conditions within bounds: two one-sided tests (TOST, Schuirmann 1987)."""

import math
from typing import Literal

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike
from scipy import stats
from statsmodels.stats.weightstats import ttost_ind, ttost_paired

from haptigraph.analysis.study.statistics.exact import (
    EXACT_UP_TO,
    rank_sum_distribution,
    signed_rank_distribution,
    tails,
)
from haptigraph.analysis.study.statistics.rank_tests import differences, equalised
from haptigraph.analysis.study.statistics.shift import paired_shift, unpaired_shift
from haptigraph.errors import BadInput

__all__ = ["Equivalence", "equivalence"]

Side = Literal["greater", "less"]


class Equivalence(Struct, frozen=True):
    """The test of the hypothesis that the difference, second minus first, lies outside the bounds."""

    bound_low: float
    bound_high: float
    alpha: float
    estimate: float
    """Hodges-Lehmann."""
    low: float
    """Lower limit of its interval, of confidence 1 - 2 alpha; NaN where there are too few values."""
    high: float
    p: float
    """The larger p-value of both one-sided rank tests; equivalent where it is below alpha."""
    p_t: float
    """The larger p-value of both one-sided t tests (paired, or Welch's); NaN where there is none."""
    variant: str

    @property
    def is_shown(self) -> bool:
        """Whether the conditions are equivalent within the bounds."""
        return self.p < self.alpha


def equivalence(
    first: ArrayLike, second: ArrayLike, low: float, high: float, *, paired: bool, alpha: float = 0.05
) -> Equivalence:
    """Test whether the difference between two conditions lies within bounds that were set in advance.

    Args:
        first: (n,) of one condition.
        second: (m,) of the other; if paired, of the same participants in the same order.
        low: Lower bound of the difference (second minus first), in the unit of the values.
        high: Upper bound.
        paired: Whether the same participants completed both.
        alpha: Level of each one-sided test.

    Raises:
        BadInput: If the bounds are not in ascending order.
    """
    if not low < high or not math.isfinite(low) or not math.isfinite(high):
        raise BadInput(f"equivalence needs a lower bound below the upper one; found {low:g} and {high:g}")
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    shift = (paired_shift if paired else unpaired_shift)(first, second, 1 - 2 * alpha)
    one_sided = _signed_p if paired else _sum_p
    p = max(one_sided(first + low, second, "greater"), one_sided(first + high, second, "less"))
    counted = len(first) if paired else max(len(first), len(second))
    name = "Wilcoxon signed-rank, zeros dropped" if paired else "Mann-Whitney U"
    kind = "exact" if counted <= EXACT_UP_TO else "normal approximation with continuity correction"
    variant = f"TOST by {name}, {kind}"
    return Equivalence(
        low,
        high,
        alpha,
        shift.estimate,
        shift.low,
        shift.high,
        p,
        _t_p(first, second, low, high, paired=paired),
        variant,
    )


def _signed_p(first: ArrayLike, second: ArrayLike, side: Side) -> float:
    difference = differences(first, second)
    moved = difference[difference != 0]
    if not len(moved):
        return 1.0
    if len(difference) > EXACT_UP_TO:
        return float(stats.wilcoxon(moved, correction=True, alternative=side, method="asymptotic").pvalue)
    ranks = stats.rankdata(np.abs(moved))
    return _tail(tails(signed_rank_distribution(ranks), float(ranks[moved > 0].sum())), side)


def _sum_p(first: ArrayLike, second: ArrayLike, side: Side) -> float:
    first, second = equalised(first, second)
    if max(len(first), len(second)) > EXACT_UP_TO:
        return float(stats.mannwhitneyu(second, first, alternative=side, method="asymptotic").pvalue)
    ranks = stats.rankdata(np.concatenate((first, second)))
    total = float(ranks[len(first) :].sum())
    return _tail(tails(rank_sum_distribution(ranks, len(second)), total), side)


def _tail(both: tuple[float, float], side: Side) -> float:
    return min(1.0, both[side == "greater"])


def _t_p(first: ArrayLike, second: ArrayLike, low: float, high: float, *, paired: bool) -> float:
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    spread = [second - first] if paired else [first, second]
    if min(map(len, spread)) < 2 or max(map(np.ptp, spread)) == 0:
        return math.nan
    if paired:
        return float(ttost_paired(second, first, low, high)[0])
    return float(ttost_ind(second, first, low, high, usevar="unequal")[0])
