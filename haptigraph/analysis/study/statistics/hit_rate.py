"""Compare how many participants hit the target in two conditions: exact tests with odds ratios."""

import math
from collections.abc import Sequence

from msgspec import Struct
from scipy import stats

__all__ = ["HitRate", "paired_hits", "unpaired_hits"]


class HitRate(Struct, frozen=True):
    """The two-sided test of one pair of conditions."""

    n_first: int
    """Participants with runs in the first condition."""
    hits_first: int
    """Those who hit the target in all of them."""
    n_second: int
    hits_second: int
    only_first: int
    """Paired: participants who hit in the first condition alone; 0 if unpaired."""
    only_second: int
    odds_ratio: float
    """Conditional estimate, second to first; NaN where both samples are alike without any miss."""
    low: float
    """Lower limit of its exact 95 % interval."""
    high: float
    p: float
    variant: str


def paired_hits(first: Sequence[bool], second: Sequence[bool]) -> HitRate:
    """McNemar's exact test: of the participants who hit in one condition alone, half in each (binomial).

    The interval of the odds ratio is that of Clopper and Pearson (1934) for this share.

    Args:
        first: (n,) whether each participant hit in one condition.
        second: (n,) the same in the other condition, in the same order.
    """
    n = len(first)
    only_first = sum(a and not b for a, b in zip(first, second, strict=True))
    only_second = sum(b and not a for a, b in zip(first, second, strict=True))
    counts = (n, sum(first), n, sum(second), only_first, only_second)
    name, discordant = "McNemar, exact binomial, two-sided", only_first + only_second
    if not discordant:
        return HitRate(*counts, math.nan, math.nan, math.nan, 1.0, f"{name}: no test")
    tested = stats.binomtest(only_second, discordant)
    limits = tested.proportion_ci(0.95, method="exact")
    odds, low, high = map(_odds, (only_second / discordant, float(limits.low), float(limits.high)))
    return HitRate(*counts, odds, low, high, float(tested.pvalue), name)


def unpaired_hits(first: Sequence[bool], second: Sequence[bool]) -> HitRate:
    """Fisher's exact test of two groups of participants; the odds ratio is the conditional estimate.

    Args:
        first: (n,) whether each participant hit, in one condition.
        second: (m,) in the other.
    """
    n, m, a, b = len(first), len(second), sum(first), sum(second)
    name, counts = "Fisher, exact, two-sided", (n, a, m, b, 0, 0)
    if a + b in (0, n + m):
        return HitRate(*counts, math.nan, math.nan, math.nan, 1.0, f"{name}: no test")
    crossed = [[b, m - b], [a, n - a]]
    ratio = stats.contingency.odds_ratio(crossed, kind="conditional")
    limits = ratio.confidence_interval(0.95)
    p = float(stats.fisher_exact(crossed).pvalue)
    return HitRate(*counts, float(ratio.statistic), float(limits.low), float(limits.high), p, name)


def _odds(share: float) -> float:
    return share / (1 - share) if share < 1 else math.inf
