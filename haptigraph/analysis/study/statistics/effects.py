"""Effect size: rank-biserial correlation with a seeded bootstrap interval.

SciPy provides the bootstrap, but neither correlation.
"""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from haptigraph.analysis.study.statistics.rank_tests import differences

__all__ = [
    "RESAMPLES",
    "Effect",
    "matched_rank_biserial",
    "paired_effect",
    "rank_biserial",
    "unpaired_effect",
]

RESAMPLES = 9999
BATCH = 1000  # resamples held in memory at once


class Effect(Struct, frozen=True):
    """A rank-biserial correlation, from -1 to 1; positive: the second condition has the larger values."""

    r: float
    low: float
    """Lower limit of the 95 % interval; NaN where the data allow none."""
    high: float
    variant: str


def matched_rank_biserial(difference: ArrayLike, axis: int = -1) -> NDArray[np.float64]:
    """Return the matched-pairs rank-biserial correlation: (W+ - W-) / (W+ + W-).

    Kerby (2014), The simple difference formula, Comprehensive Psychology 3. Zeros are dropped before ranking.

    Args:
        difference: Second minus first; (n,) or more dimensions.
        axis: The axis of the pairs.
    """
    difference = np.asarray(difference, np.float64)
    zeros = (difference == 0).sum(axis=axis, keepdims=True)
    moved = np.sign(difference)
    ranks = (stats.rankdata(np.abs(difference), axis=axis) - zeros) * np.abs(moved)
    total = ranks.sum(axis=axis)
    return np.asarray((moved * ranks).sum(axis=axis) / np.where(total > 0, total, 1.0))


def rank_biserial(first: ArrayLike, second: ArrayLike, axis: int = -1) -> NDArray[np.float64]:
    """Return the rank-biserial correlation of independent samples: 2 U / (n m) - 1, which is Cliff's delta.

    Args:
        first: (n,) or more dimensions.
        second: (m,) or more.
        axis: The axis of the observations.
    """
    first, second = np.asarray(first, np.float64), np.asarray(second, np.float64)
    n, m = first.shape[axis], second.shape[axis]
    ranks = stats.rankdata(np.concatenate((first, second), axis=axis), axis=axis)
    u = np.take(ranks, range(n, n + m), axis=axis).sum(axis=axis) - m * (m + 1) / 2
    return np.asarray(2 * u / (n * m) - 1)


def paired_effect(first: ArrayLike, second: ArrayLike, seed: int) -> Effect:
    """Return the effect size of paired values; pairs are resampled.

    Args:
        first: (n,) of one condition.
        second: (n,) of the other.
        seed: Of the bootstrap.
    """
    return _effect((differences(first, second),), matched_rank_biserial, "matched-pairs rank-biserial", seed)


def unpaired_effect(first: ArrayLike, second: ArrayLike, seed: int) -> Effect:
    """Return the effect size of independent samples; each is resampled separately."""
    samples = (np.asarray(first, np.float64), np.asarray(second, np.float64))
    return _effect(samples, rank_biserial, "rank-biserial", seed)


def _effect(samples: tuple[Any, ...], statistic: Callable[..., Any], name: str, seed: int) -> Effect:
    r = float(statistic(*samples))
    if min(len(sample) for sample in samples) < 2:
        return Effect(r, float("nan"), float("nan"), f"{name}, no interval (fewer than 2 values)")
    for method, description in (("BCa", "bias-corrected accelerated"), ("percentile", "percentile")):
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # a degenerate sample has no BCa interval, which is stated below
            found = stats.bootstrap(
                samples,
                statistic,
                n_resamples=RESAMPLES,
                batch=BATCH,
                method=method,
                rng=np.random.default_rng(seed),
            ).confidence_interval
        if np.isfinite((found.low, found.high)).all():
            method_text = f"{description}, {RESAMPLES} resamples, seed {seed}"
            variant = f"{name}, 95 % bootstrap interval ({method_text})"
            return Effect(r, float(found.low), float(found.high), variant)
    return Effect(r, float("nan"), float("nan"), f"{name}, no interval (degenerate sample)")
