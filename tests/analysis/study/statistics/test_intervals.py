import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from interval_coverage import effect_limits
from scipy import stats

from haptigraph.analysis.study.statistics.effects import paired_effect, unpaired_effect
from haptigraph.analysis.study.statistics.rank_tests import rank_sum, signed_rank
from haptigraph.analysis.study.statistics.shift import paired_shift, unpaired_shift

# Hollander & Wolfe (1973), as in R's ?wilcox.test.
BEFORE = [1.83, 0.50, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.30]
AFTER = [0.878, 0.647, 0.598, 2.05, 1.06, 1.29, 1.06, 3.14, 1.29]
PLACENTA = [0.80, 0.83, 1.89, 1.04, 1.45, 1.38, 1.91, 1.64, 0.73, 1.46]
TERM = [1.15, 0.88, 0.90, 0.74, 1.21]


def test_an_effect_without_any_exception_is_not_known_exactly():
    effect = paired_effect(np.zeros(6), range(1, 7), 0)
    odds = np.exp(np.outer(np.linspace(0, 0.2, 2001), np.arange(1, 7)))  # of a rise: the larger, the likelier
    all_rise = np.prod(odds / (1 + odds), axis=1)
    correlations = (odds - 1) / (odds + 1) @ np.arange(1, 7) / 21
    expected = np.interp(0.025, all_rise, correlations)
    assert (effect.r, effect.high) == (1, 1) and effect.low == pytest.approx(expected, abs=1e-3)
    assert unpaired_effect(range(6), range(10, 16), 0).low < 0.5


def test_too_few_values_have_no_interval_and_the_effect_says_why():
    assert not math.isnan(paired_effect(np.zeros(6), range(1, 7), 0).low)
    for effect in (
        paired_effect(np.zeros(5), range(1, 6), 0),
        paired_effect(np.zeros(9), [0, 0, 0, 0, 1, 2, 3, 4, 5], 0),
        paired_effect([1.0], [1.0], 0),
        unpaired_effect([1, 2, 3], [4, 5, 6], 0),
    ):
        assert math.isnan(effect.low) and math.isnan(effect.high)
        assert "no interval (too few" in effect.variant


def test_beyond_fifty_values_the_bootstrap_has_no_interval_of_width_zero():
    effect = paired_effect(np.zeros(51), np.arange(1, 52), 3)
    assert effect.r == 1 and math.isnan(effect.low) and "degenerate" in effect.variant
    rng = np.random.default_rng(2)
    first, second = rng.normal(size=60), rng.normal(0.5, size=60)
    effect = unpaired_effect(first, second, 3)
    assert effect.low < effect.r < effect.high and "seed 3" in effect.variant
    assert effect == unpaired_effect(first, second, 3)


@given(st.lists(st.integers(-6, 6), min_size=6, max_size=10).filter(lambda d: sum(map(bool, d)) > 5))
def test_the_interval_excludes_zero_exactly_where_the_test_is_significant(difference):
    zeros = np.zeros(len(difference))
    effect, back = paired_effect(zeros, difference, 0), paired_effect(difference, zeros, 0)
    p = signed_rank(zeros, difference).p
    if not math.isnan(effect.low) and abs(p - 0.05) > 1e-9:
        assert (effect.low > 0 or effect.high < 0) == (p < 0.05)
    assert effect.low <= effect.r <= effect.high or math.isnan(effect.low)
    assert (effect.low, effect.high) == pytest.approx((-back.high, -back.low), abs=1e-6, nan_ok=True)


@given(*[st.lists(st.integers(0, 9), min_size=4, max_size=8)] * 2)
def test_so_does_that_of_two_samples(first, second):
    effect, p = unpaired_effect(first, second, 0), rank_sum(first, second).p
    if not math.isnan(effect.low) and abs(p - 0.05) > 1e-9:
        assert (effect.low > 0 or effect.high < 0) == (p < 0.05)
        assert effect.low <= effect.r + 1e-9 and effect.r <= effect.high + 1e-9


@pytest.mark.parametrize(("n", "effect"), [(6, 0.8), (10, 0.0), (16, 0.5)])
@pytest.mark.parametrize("paired", [True, False])
def test_coverage_is_nominal(n, effect, paired):
    rng, quantile = np.random.default_rng(8), float(stats.norm.ppf((1 + effect) / 2))
    first = np.zeros((1500, n)) if paired else rng.normal(size=(1500, n))
    shift = quantile / math.sqrt(2) if paired else quantile * math.sqrt(2)  # of normal values
    low, high = effect_limits(first, rng.normal(shift, 1, (1500, n)), paired=paired).T
    assert 0.92 <= np.mean((low <= effect) & (effect <= high)) <= 0.98


def test_hodges_lehmann_agrees_with_r():
    shift = paired_shift(BEFORE, AFTER)  # R: wilcox.test(AFTER, BEFORE, paired = TRUE, conf.int = TRUE)
    assert (shift.estimate, shift.low, shift.high) == pytest.approx((-0.46, -0.786, -0.01), abs=1e-9)
    shift = unpaired_shift(TERM, PLACENTA)
    assert (shift.estimate, shift.low, shift.high) == pytest.approx((0.305, -0.15, 0.76), abs=1e-9)
    assert shift.variant == "Hodges-Lehmann, 95 % interval (exact)"
    few = paired_shift([0, 0, 0, 0, 0], [1, 2, 3, 4, 6])
    assert few.estimate == 3 and math.isnan(few.low) and "too few" in few.variant


@pytest.mark.parametrize("n", [9, 60])
def test_the_test_rejects_every_shift_outside_the_interval_of_hodges_and_lehmann(n):
    rng = np.random.default_rng(n)
    first, second = rng.normal(size=n), rng.normal(1, 2, size=n)
    for shift, test in (
        (paired_shift(first, second), signed_rank),
        (unpaired_shift(first, second), rank_sum),
    ):
        for limit, outwards in ((shift.low, -1), (shift.high, 1)):
            assert (
                test(first + limit + 1e-6 * outwards, second).p
                < 0.05
                < test(first + limit - 1e-6 * outwards, second).p
            )


TIED = st.lists(st.integers(-4, 4), min_size=8, max_size=12)


@given(TIED, TIED, st.integers(-5, 5))
def test_the_interval_of_tied_values_holds_the_estimate_and_follows_sign_shift_and_level(
    first, second, moved
):
    count = min(len(first), len(second))
    for shift_of, one, other in (
        (paired_shift, first[:count], second[:count]),
        (unpaired_shift, first, second),
    ):
        shift, wider = shift_of(one, other), shift_of(one, other, 0.97)
        assert wider.low <= shift.low <= shift.estimate <= shift.high <= wider.high
        back, elsewhere = shift_of(other, one), shift_of(one, np.array(other) + moved)
        found = np.array([shift.estimate, shift.low, shift.high])
        assert [-back.estimate, -back.high, -back.low] == pytest.approx(found, abs=1e-9)
        assert [elsewhere.estimate, elsewhere.low, elsewhere.high] == pytest.approx(found + moved, abs=1e-9)


@pytest.mark.parametrize(("shift_of", "shift"), [(paired_shift, 0.24), (unpaired_shift, 0.49)])
def test_the_interval_of_rounded_values_covers_also_shortly_before_the_true_value_jumps(shift_of, shift):
    rng = np.random.default_rng(5)
    first, second = np.rint(rng.normal(0, 1.5, (1500, 16))), np.rint(rng.normal(shift, 1.5, (1500, 16)))
    first = first * (shift_of is unpaired_shift)  # the differences of pairs are the rounded values
    found = [shift_of(one, other) for one, other in zip(first, second, strict=True)]
    assert np.mean([each.low <= 0 <= each.high for each in found]) >= 0.95  # 0 is true: P(larger) is 0.496
