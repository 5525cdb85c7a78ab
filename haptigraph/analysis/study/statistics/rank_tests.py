"""Rank tests of two conditions, each with the exact name of its variant.

Published p-values of the same data differ by variant: exact or approximate, with or without continuity
correction, zeros dropped (Wilcoxon 1945) or ranked first (Pratt 1959). SciPy performs the tests, except for
the exact distribution over mid-ranks (shift algorithm, Streitberg & Roehmel 1986): SciPy enumerates all
permutations, which takes a minute for 16 participants.
"""

from collections.abc import Sequence
from math import comb
from typing import Literal

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray
from scipy import stats

__all__ = [
    "RankTest",
    "Zeros",
    "differences",
    "every_rank_sum",
    "every_signed_rank",
    "rank_sum",
    "signed_rank",
]

EXACT_UP_TO = 50  # as in R and SciPy; beyond it the approximation is as good
TIE_DIGITS = 12  # differences that agree to this many digits are tied, despite rounding
Floats = NDArray[np.float64]
Zeros = Literal["dropped", "pratt"]


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
    plain = not tied and (not none or zeros == "dropped")
    if not len(moved):
        p = 1.0
    elif is_exact and plain:
        p = float(stats.wilcoxon(moved, method="exact").pvalue)
    elif is_exact:
        p = _exact_signed(ranks, min(plus, minus))
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
    first: ArrayLike, second: ArrayLike, *, exact: bool | None = None, continuity: bool = True
) -> RankTest:
    """Mann-Whitney's test of two independent samples (Wilcoxon's rank-sum test), two-sided.

    Args:
        first: (n,) of one condition, no NaN.
        second: (m,) of the other.
        exact: Exact or approximate; None: exact up to 50 observations in the larger sample.
        continuity: Of the approximation.
    """
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    both = np.concatenate((first, second))
    both = _tied_values(both, np.abs(both).max(initial=0.0))
    first, second = both[: len(first)], both[len(first) :]
    ranks = _ranks(both, signed=True)
    tied = _tie_count(ranks)
    is_exact = max(len(first), len(second)) <= EXACT_UP_TO if exact is None else exact
    tested = stats.mannwhitneyu(
        second, first, use_continuity=continuity, method="exact" if is_exact and not tied else "asymptotic"
    )
    p = (
        _exact_sum(ranks, len(second), float(ranks[len(first) :].sum()))
        if is_exact and tied
        else tested.pvalue
    )
    variant = _variant_name("Mann-Whitney U", is_exact, continuity, tied)
    u = float(tested.statistic)
    constant = bool(np.all(both == both[0]))
    p = 1.0 if constant else float(p)
    return RankTest(u, len(first) * len(second) - u, p, len(both), 0, tied, variant)


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
    return [rank_sum(first, second, exact=exact, continuity=continuity) for exact, continuity in options]


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


def _exact_signed(ranks: Floats, smaller: float) -> float:
    """Return the two-sided p of a rank sum when both signs are equally likely."""
    probabilities = np.ones(1)
    for rank in np.rint(2 * ranks).astype(int):  # twice a mid-rank is an integer
        longer = np.zeros(len(probabilities) + rank)
        longer[: len(probabilities)] += probabilities / 2
        longer[rank:] += probabilities / 2
        probabilities = longer
    return min(1.0, 2 * float(probabilities[: round(2 * smaller) + 1].sum()))


def _exact_sum(ranks: Floats, chosen: int, total: float) -> float:
    """Return the two-sided p of the sum of `chosen` ranks when all choices are equally likely."""
    doubled = np.rint(2 * ranks).astype(int)
    counts = np.zeros((chosen + 1, int(doubled.sum()) + 1))
    counts[0, 0] = 1
    for rank in doubled:
        counts[1:, rank:] += counts[:-1, : counts.shape[1] - rank].copy()
    probabilities, at = counts[chosen] / comb(len(ranks), chosen), round(2 * total)
    return min(1.0, 2 * float(min(probabilities[: at + 1].sum(), probabilities[at:].sum())))
