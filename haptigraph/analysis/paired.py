"""Paired comparisons, by SciPy: Wilcoxon's signed-rank test, its variant named, with effect size and Holm.

Turns two values per participant into a p-value that says how it was computed: published ones differ by that.
"""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from haptigraph.errors import MissingExtra

__all__ = ["SignedRank", "holm", "signed_rank"]

EXACT_UP_TO = 50  # pairs without ties, where SciPy tabulates the distribution
ALL_SIGNS_UP_TO = 16  # pairs with ties: 2 ** 16 sign patterns are all tried


class SignedRank(Struct, frozen=True):
    """One Wilcoxon signed-rank test, two-sided (Wilcoxon 1945)."""

    pairs: int
    zeros: int
    """Pairs without difference; they are dropped, as Wilcoxon did."""
    statistic: float
    """The smaller rank sum; nan if no pair differs."""
    p: float
    """1 if no pair differs."""
    variant: str
    """How p was computed."""
    mean_difference: float
    """Second minus first."""
    effect: float
    """Matched-pairs rank-biserial correlation (Kerby 2014): 1 if all differences are up, -1 if down."""


def signed_rank(first: Sequence[float], second: Sequence[float]) -> SignedRank:
    """Compare two values of each participant.

    Args:
        first: Values under one condition, (n,).
        second: Those of the same participants under another.

    Raises:
        MissingExtra: If SciPy is not installed.
    """
    try:
        from scipy import stats  # noqa: PLC0415
    except ImportError:
        raise MissingExtra("the comparison's statistics", "analysis") from None
    difference = np.round(np.subtract(second, first, dtype=np.float64), 9)  # else rounding would undo ties
    nonzero = difference[difference != 0]
    mean = float(difference.mean())
    zeros = len(difference) - len(nonzero)
    if not len(nonzero):
        return SignedRank(len(difference), zeros, math.nan, 1.0, "no pair differs", mean, 0.0)
    ranks = stats.rankdata(np.abs(nonzero))
    effect = float((ranks * np.sign(nonzero)).sum() / ranks.sum())
    has_ties = len(np.unique(np.abs(nonzero))) < len(nonzero)
    if not has_ties and len(nonzero) <= EXACT_UP_TO:
        result, variant = stats.wilcoxon(nonzero, method="exact"), "exact"
    elif len(nonzero) <= ALL_SIGNS_UP_TO:
        every = stats.PermutationMethod(n_resamples=np.inf)
        result, variant = stats.wilcoxon(nonzero, method=every), "exact over all signs, mid-ranks"
    else:
        result = stats.wilcoxon(nonzero, method="asymptotic", correction=True)
        variant = "normal, mid-ranks, continuity corrected"
    return SignedRank(
        len(difference), zeros, float(result.statistic), float(result.pvalue), variant, mean, effect
    )


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values corrected for their number (Holm 1979, Scand. J. Stat. 6), in the same order."""
    adjusted, largest = [0.0] * len(p_values), 0.0
    for rank, place in enumerate(np.argsort(p_values, kind="stable")):
        largest = max(largest, min(1.0, (len(p_values) - rank) * p_values[place]))
        adjusted[int(place)] = largest
    return adjusted
