"""Effect size: rank-biserial correlation with an interval that belongs to the exact rank test.

SciPy has neither correlation. Beyond the 50 values of the exact test, SciPy's bootstrap gives the interval.
"""

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike, NDArray
from scipy import stats

from haptigraph.analysis.study.statistics.exact import (
    EXACT_UP_TO,
    Floats,
    rank_sum_distribution,
    signed_rank_distribution,
)
from haptigraph.analysis.study.statistics.intervals import (
    WIDENED_ABOVE,
    Limits,
    fisher_interval,
    tilted_interval,
    widest,
)
from haptigraph.analysis.study.statistics.rank_tests import differences, equalised

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
    """Return the effect size of paired values.

    Args:
        first: (n,) of one condition.
        second: (n,) of the other.
        seed: Of the bootstrap beyond 50 pairs.
    """
    difference, name = differences(first, second), "matched-pairs rank-biserial"
    moved = difference[difference != 0]
    if len(moved) > EXACT_UP_TO:
        return _bootstrapped((difference,), matched_rank_biserial, name, seed)
    r, ranks = float(matched_rank_biserial(moved)), stats.rankdata(np.abs(moved))
    half = float(ranks.sum()) / 2
    limits = tilted_interval(signed_rank_distribution(ranks), half * (1 + r), half, half)
    signs = np.sign(np.add.outer(moved, moved))
    influence = 2 * (signs.sum(axis=0) - np.sign(moved)) / max(1, len(moved) - 1)
    return _exact(r, limits, (influence,), f"{name} of {len(moved)} differences")


def unpaired_effect(first: ArrayLike, second: ArrayLike, seed: int) -> Effect:
    """Return the effect size of independent samples.

    Args:
        first: (n,) of one condition.
        second: (m,) of the other.
        seed: Of the bootstrap beyond 50 values in a sample, which resamples each separately.
    """
    first, second = equalised(first, second)
    n, m = len(first), len(second)
    if max(n, m) > EXACT_UP_TO:
        return _bootstrapped((first, second), rank_biserial, "rank-biserial", seed)
    r, ranks = float(rank_biserial(first, second)), stats.rankdata(np.concatenate((first, second)))
    half, center = n * m / 2, m * (n + m + 1) / 2
    limits = tilted_interval(rank_sum_distribution(ranks, m), center + half * r, center, half)
    signs = np.sign(np.subtract.outer(second, first))
    influences = (signs.mean(axis=0), signs.mean(axis=1))
    return _exact(r, limits, influences, f"rank-biserial of {n} and {m} values")


def _exact(r: float, limits: Limits, influences: tuple[Floats, ...], name: str) -> Effect:
    how = "95 % interval by inverting the exact test"
    if np.isnan(limits).any():
        how = "no interval (too few: no ranks of these values reach p < 0.05)"
    elif min(map(len, influences)) > WIDENED_ABOVE:
        limits, how = widest(limits, fisher_interval(r, *influences)), f"{how}, or by Fisher's z where wider"
    return Effect(r, *limits, f"{name}, {how}")


def _bootstrapped(samples: tuple[Any, ...], statistic: Callable[..., Any], name: str, seed: int) -> Effect:
    r = float(statistic(*samples))
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")  # a degenerate sample has no interval, which is stated below
        found = stats.bootstrap(
            samples,
            statistic,
            n_resamples=RESAMPLES,
            batch=BATCH,
            method="BCa",
            rng=np.random.default_rng(seed),
        ).confidence_interval
    if not np.isfinite((found.low, found.high)).all():
        return Effect(r, float("nan"), float("nan"), f"{name}, no interval (degenerate sample)")
    how = f"bias-corrected accelerated, {RESAMPLES} resamples, seed {seed}"
    return Effect(r, float(found.low), float(found.high), f"{name}, 95 % bootstrap interval ({how})")
