"""Exact null distributions of rank sums, also over mid-ranks.

By the shift algorithm of Streitberg and Roehmel (1986): SciPy enumerates all permutations of tied ranks,
which takes a minute for 16 participants. Index k of a distribution is the sum k / 2, because twice a mid-rank
is an integer.
"""

from math import comb

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "EXACT_UP_TO", "Floats", "quantile", "rank_sum_distribution", "signed_rank_distribution", "smallest_p",
    "tails",
]  # fmt: skip

EXACT_UP_TO = 50  # as in R and SciPy; beyond it the approximation is as good
Floats = NDArray[np.float64]


def signed_rank_distribution(ranks: Floats) -> Floats:
    """Return the distribution of the sum of positive ranks when both signs are equally likely.

    Args:
        ranks: (n,) of the absolute differences.
    """
    probabilities = np.ones(1)
    for rank in np.rint(2 * ranks).astype(int):
        longer = np.zeros(len(probabilities) + rank)
        longer[: len(probabilities)] += probabilities / 2
        longer[rank:] += probabilities / 2
        probabilities = longer
    return probabilities


def rank_sum_distribution(ranks: Floats, chosen: int) -> Floats:
    """Return the distribution of the sum of `chosen` ranks when all choices are equally likely.

    Args:
        ranks: (n,) of both samples.
        chosen: Size of the sample whose ranks are summed.
    """
    doubled = np.rint(2 * ranks).astype(int)
    counts = np.zeros((chosen + 1, int(doubled.sum()) + 1))
    counts[0, 0] = 1
    for rank in doubled:
        counts[1:, rank:] += counts[:-1, : counts.shape[1] - rank].copy()
    return np.asarray(counts[chosen] / comb(len(ranks), chosen))


def tails(probabilities: Floats, total: float) -> tuple[float, float]:
    """Return the probabilities of a sum of at most, and at least, `total`."""
    at = round(2 * total)
    return float(probabilities[: at + 1].sum()), float(probabilities[at:].sum())


def smallest_p(first: int, second: int, *, paired: bool) -> float:
    """Return the two-sided p-value of the most extreme ranks; with few values it is not significant.

    Args:
        first: Number of values of one condition.
        second: Of the other; the same if paired.
        paired: Whether of the same participants.
    """
    return min(1.0, 2.0 ** (1 - first) if paired else 2 / comb(first + second, first))


def quantile(probabilities: Floats, tail: float) -> float:
    """Return the smallest sum that is not exceeded with a probability of at least `tail`."""
    return int(np.searchsorted(np.cumsum(probabilities), tail * (1 + 1e-12))) / 2
