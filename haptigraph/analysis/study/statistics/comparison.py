"""Compare one quantity between two conditions: rank test, effect size, shift, equivalence, t test, power."""

import math
from collections.abc import Sequence

import numpy as np
from msgspec import Struct
from scipy import stats

from haptigraph.analysis.study.quantities import Quantity
from haptigraph.analysis.study.statistics.effects import Effect, paired_effect, unpaired_effect
from haptigraph.analysis.study.statistics.equivalence import Equivalence, equivalence
from haptigraph.analysis.study.statistics.rank_tests import (
    RankTest,
    Zeros,
    every_rank_sum,
    every_signed_rank,
    rank_sum,
    signed_rank,
)
from haptigraph.analysis.study.statistics.sensitivity import (
    Normality,
    Power,
    TTest,
    normality,
    paired_power,
    paired_t,
    unpaired_power,
    welch_t,
)
from haptigraph.analysis.study.statistics.shift import Shift, paired_shift, unpaired_shift

__all__ = ["Comparison", "Sample", "compare", "omnibus"]


class Sample(Struct, frozen=True):
    """Descriptive statistics of one value per participant."""

    n: int
    mean: float
    sd: float
    median: float
    lower: float
    """Lower quartile."""
    upper: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Sample":
        """Describe values; NaN where there are too few."""
        if not values:
            return cls(0, *[math.nan] * 5)
        lower, median, upper = (float(part) for part in np.percentile(values, (25, 50, 75)))
        sd = float(np.std(values, ddof=1)) if len(values) > 1 else math.nan
        return cls(len(values), float(np.mean(values)), sd, median, lower, upper)


class Comparison(Struct, frozen=True):
    """The test of one hypothesis: a quantity is the same in both conditions."""

    quantity: Quantity
    first: str
    second: str
    is_paired: bool
    samples: tuple[Sample, Sample]
    left_out: int
    """Number of participants without a value in one of the conditions."""
    test: RankTest
    variants: list[RankTest]
    effect: Effect
    normality: list[Normality]
    """Of the differences; unpaired: of each sample."""
    t: TTest
    power: Power
    shift: Shift
    equivalence: Equivalence | None
    """None without bounds."""


def compare(
    quantity: Quantity,
    names: tuple[str, str],
    values: tuple[Sequence[float], Sequence[float]],
    *,
    paired: bool,
    seed: int,
    alpha: float = 0.05,
    zeros: Zeros = "dropped",
    left_out: int = 0,
    bounds: tuple[float, float] | None = None,
) -> Comparison | None:
    """Compare two conditions; return None if one has no values.

    Args:
        quantity: The outcome.
        names: Of the conditions; the effect is positive where the second has larger values.
        values: Of each condition; if paired, of the same participants in the same order.
        paired: Whether the same participants completed both.
        seed: Of the bootstrap of large samples.
        alpha: Level of significance, for the power.
        zeros: Treatment of pairs without a difference.
        left_out: Copied to the result.
        bounds: Of a difference (second minus first) that counts as none; None: no test of equivalence.
    """
    first, second = values
    if not first or not second:
        return None
    samples = (Sample.of(first), Sample.of(second))
    common = (quantity, *names, paired, samples, left_out)
    alike = equivalence(first, second, *bounds, paired=paired, alpha=alpha) if bounds else None
    if paired:
        t = paired_t(first, second)
        return Comparison(
            *common,
            signed_rank(first, second, zeros=zeros),
            every_signed_rank(first, second),
            paired_effect(first, second, seed),
            [normality(np.asarray(second) - np.asarray(first))],
            t,
            paired_power(t.d, len(first), alpha),
            paired_shift(first, second),
            alike,
        )
    t = welch_t(first, second)
    return Comparison(
        *common,
        rank_sum(first, second),
        every_rank_sum(first, second),
        unpaired_effect(first, second, seed),
        [normality(first), normality(second)],
        t,
        unpaired_power(t.d, len(first), len(second), alpha),
        unpaired_shift(first, second),
        alike,
    )


def omnibus(samples: Sequence[Sequence[float]], *, paired: bool) -> tuple[str, float, float]:
    """Test three or more conditions at once; return the test's name, its statistic and p.

    Args:
        samples: Per condition; if paired, of the same participants in the same order.
        paired: Friedman's test with tie correction; otherwise the Kruskal-Wallis test.
    """
    name = "Friedman" if paired else "Kruskal-Wallis"
    name += ", chi-square approximation with tie correction"
    ranked = np.array(samples, np.float64) if paired else np.concatenate([*map(np.asarray, samples)])
    if min(len(sample) for sample in samples) < 2 or not np.ptp(ranked, axis=0).any():  # all ranks are tied
        return f"{name}: no test", math.nan, math.nan
    tested = stats.friedmanchisquare(*samples) if paired else stats.kruskal(*samples)
    return name, float(tested.statistic), float(tested.pvalue)
