"""Rank tests of two conditions, each with the exact name of its variant.

Published p-values of the same data differ by variant: exact or approximate, with or without continuity
correction, zeros dropped (Wilcoxon 1945) or ranked first (Pratt 1959). The distribution over mid-ranks of two
samples may be skewed; then its two-sided p is twice the smaller tail (as in SciPy and in R's wilcox.test) or
the sum of all outcomes at least as far from the mean (as in R's coin and exactRankTests).
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike
from scipy import stats

from haptigraph.analysis.study.statistics.exact import (
    EXACT_UP_TO,
    Floats,
    rank_sum_distribution,
    signed_rank_distribution,
    tails,
)

__all__ = [
    "RankTest",
    "Zeros",
    "differences",
    "equalised",
    "every_rank_sum",
    "every_signed_rank",
    "rank_sum",
    "signed_rank",
]

TIE_DIGITS = 12  # differences that agree to this many digits are tied, despite rounding
Zeros = Literal["dropped", "pratt"]
Sides = Literal["doubled", "summed"]


class RankTest(Struct, frozen=True):
    """One two-sided test."""

    statistic: float
    """Signed-rank: sum of the ranks of positive differences (W+). Rank-sum: U of the second sample."""
    opposite: float
    """W- or U of the first sample."""
    p: float
    pairs: int
    """Number of differences, or of observations in both samples."""
    zeros: int
    ties: int
    """Number of values that share their rank."""
    variant: str


def equalised(first: ArrayLike, second: ArrayLike) -> tuple[Floats, Floats]:
    """Return both samples, (n,) and (m,), with values equalised that differ only by rounding."""
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    both = np.concatenate((first, second))
    both = _tied_values(both, np.abs(both).max(initial=0.0))
    return both[: len(first)], both[len(first) :]


def differences(first: ArrayLike, second: ArrayLike) -> Floats:
    """Return second minus first, with values equalised that differ only by rounding.

    Args:
        first: (n,)
        second: (n,)
    """
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    return _tied_values(second - first, max(np.abs(first).max(initial=0.0), np.abs(second).max(initial=0.0)))


def signed_rank(
    first: ArrayLike,
    second: ArrayLike,
    *,
    zeros: Zeros = "dropped",
    exact: bool | None = None,
    continuity: bool = True,
) -> RankTest:
    """Wilcoxon's signed-rank test of paired values, two-sided.

    Args:
        first: (n,) of one condition, no NaN.
        second: (n,) of the other, of the same participants in the same order.
        zeros: Treatment of pairs without a difference.
        exact: Exact or approximate; None: exact up to 50 differences.
        continuity: Of the approximation.
    """
    difference = differences(first, second)
    moved = difference[difference != 0]
    ranks = stats.rankdata(np.abs(difference))[difference != 0] if zeros == "pratt" else _ranks(moved)
    plus, minus = float(ranks[moved > 0].sum()), float(ranks[moved < 0].sum())
    none, tied = len(difference) - len(moved), _tie_count(ranks)
    is_exact = len(moved) <= EXACT_UP_TO if exact is None else exact
    if not len(moved):
        p = 1.0
    elif is_exact:
        p = _doubled(signed_rank_distribution(ranks), plus)
    else:
        method = {"dropped": "wilcox", "pratt": "pratt"}[zeros]
        p = float(stats.wilcoxon(difference, None, method, continuity, method="asymptotic").pvalue)
    variant = _variant_name("Wilcoxon signed-rank", is_exact, continuity, tied)
    if none:
        variant += f", {none} zero{'s' * (none > 1)} " + (
            "dropped" if zeros == "dropped" else "ranked, then left out (Pratt)"
        )
    return RankTest(
        plus, minus, p, len(difference), none, tied, variant if len(moved) else f"{variant}: no test"
    )


def rank_sum(
    first: ArrayLike,
    second: ArrayLike,
    *,
    exact: bool | None = None,
    continuity: bool = True,
    sides: Sides = "doubled",
) -> RankTest:
    """Mann-Whitney's test of two independent samples (Wilcoxon's rank-sum test), two-sided.

    Args:
        first: (n,) of one condition, no NaN.
        second: (m,) of the other.
        exact: Exact or approximate; None: exact up to 50 observations in the larger sample.
        continuity: Of the approximation.
        sides: The exact p-value: twice the smaller tail, or all sums at least as far from the mean.
    """
    first, second = equalised(first, second)
    ranks = _ranks(np.concatenate((first, second)), signed=True)
    total, tied = float(ranks[len(first) :].sum()), _tie_count(ranks)
    u = total - len(second) * (len(second) + 1) / 2
    is_exact = max(len(first), len(second)) <= EXACT_UP_TO if exact is None else exact
    if np.ptp(ranks) == 0:
        p = 1.0
    elif is_exact:
        distribution = rank_sum_distribution(ranks, len(second))
        p = (_doubled if sides == "doubled" else _summed)(distribution, total)
    else:
        p = float(stats.mannwhitneyu(second, first, continuity, method="asymptotic").pvalue)
    variant = _variant_name("Mann-Whitney U", is_exact, continuity, tied)
    if is_exact:
        variant += ", twice the smaller tail" if sides == "doubled" else ", both tails summed"
    return RankTest(u, len(first) * len(second) - u, p, len(ranks), 0, tied, variant)


def every_signed_rank(first: Sequence[float], second: Sequence[float]) -> list[RankTest]:
    """Return the test in every variant that the data allow, for comparison with other software."""
    has_zeros = bool((differences(first, second) == 0).any())
    treatments: tuple[Zeros, ...] = ("dropped", "pratt") if has_zeros else ("dropped",)
    return [
        signed_rank(first, second, zeros=zeros, exact=exact, continuity=continuity)
        for zeros in treatments
        for exact, continuity in _options(len(first))
    ]


def every_rank_sum(first: Sequence[float], second: Sequence[float]) -> list[RankTest]:
    """Return the test in every variant that the data allow."""
    options = _options(max(len(first), len(second)))
    tests = [rank_sum(first, second, exact=exact, continuity=continuity) for exact, continuity in options]
    return [*tests, rank_sum(first, second, sides="summed")] if options[0][0] else tests


def _options(count: int) -> list[tuple[bool, bool]]:
    """Return the variants: is exact, with continuity correction."""
    return [*([(True, True)] if count <= EXACT_UP_TO else []), (False, True), (False, False)]


def _tied_values(values: Floats, scale: float) -> Floats:
    return np.round(values / scale, TIE_DIGITS) * scale if scale > 0 else values


def _ranks(values: Floats, *, signed: bool = False) -> Floats:
    return np.asarray(stats.rankdata(values if signed else np.abs(values)), np.float64)


def _tie_count(ranks: Floats) -> int:
    _, counts = np.unique(ranks, return_counts=True)
    return int(counts[counts > 1].sum())


def _variant_name(name: str, is_exact: bool, continuity: bool, tied: int) -> str:
    ranks = f" over mid-ranks ({tied} tied)" if tied else ""
    if is_exact:
        return f"{name}, two-sided, exact{ranks}"
    corrected = "with" if continuity else "without"
    tie = f", tie correction ({tied} tied)" if tied else ""
    return f"{name}, two-sided, normal approximation {corrected} continuity correction{tie}"


def _doubled(distribution: Floats, total: float) -> float:
    return min(1.0, 2 * min(tails(distribution, total)))


def _summed(distribution: Floats, total: float) -> float:
    sums = np.arange(len(distribution)) / 2
    mean = float(distribution @ sums)
    return min(1.0, float(distribution[np.abs(sums - mean) >= abs(total - mean) - 1e-9].sum()))
