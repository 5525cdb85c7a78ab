import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from haptigraph.analysis.study.quantities import QUANTITIES
from haptigraph.analysis.study.statistics.comparison import compare, omnibus
from haptigraph.analysis.study.statistics.effects import (
    matched_rank_biserial,
    rank_biserial,
)
from haptigraph.analysis.study.statistics.rank_tests import rank_sum, signed_rank
from haptigraph.analysis.study.statistics.sensitivity import (
    EFFICIENCY,
    normality,
    paired_power,
    paired_t,
    unpaired_power,
    welch_t,
)

BEFORE = [1.83, 0.50, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.30]
AFTER = [0.878, 0.647, 0.598, 2.05, 1.06, 1.29, 1.06, 3.14, 1.29]
SLEEP_1 = [0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0]
SLEEP_2 = [1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4]


def test_effect_is_the_difference_of_positive_and_negative_rank_sums():
    assert matched_rank_biserial(np.subtract(AFTER, BEFORE)) == pytest.approx((5 - 40) / 45)


@given(st.lists(st.integers(-5, 5), min_size=1, max_size=12).filter(any))
def test_matched_effect_follows_from_the_rank_sums(difference):
    test = signed_rank(np.zeros(len(difference)), difference)
    expected = (test.statistic - test.opposite) / (test.statistic + test.opposite)
    assert matched_rank_biserial(difference) == pytest.approx(expected, abs=1e-12)


@given(
    st.lists(st.integers(0, 9), min_size=1, max_size=7), st.lists(st.integers(0, 9), min_size=1, max_size=7)
)
def test_effect_of_two_samples_is_the_mean_sign_of_all_differences(first, second):
    wins = np.mean([np.sign(b - a) for a in first for b in second])
    assert rank_biserial(first, second) == pytest.approx(wins, abs=1e-12)
    assert 2 * rank_sum(first, second).statistic / (len(first) * len(second)) - 1 == pytest.approx(wins)


def test_t_tests_agree_with_r():
    paired = paired_t(SLEEP_1, SLEEP_2)  # R: t = 4.0621, df = 9, p-value = 0.002833, 0.7001142 to 2.4598858
    assert (paired.t, paired.df) == (pytest.approx(4.062127683382037), 9)
    assert paired.p == pytest.approx(0.002832890197384256, abs=1e-9)
    assert (paired.low, paired.high) == (
        pytest.approx(0.7001142, abs=1e-6),
        pytest.approx(2.4598858, abs=1e-6),
    )
    welch = welch_t(SLEEP_1, SLEEP_2)  # R: t = 1.8608, df = 17.776, p-value = 0.07939
    assert welch.df == pytest.approx(17.776474, abs=1e-6) and welch.p == pytest.approx(0.07939414, abs=1e-6)


def test_normality_agrees_with_scipys_reference():
    men = [148, 154, 158, 160, 161, 162, 166, 170, 182, 195, 236]  # Shapiro & Wilk (1965): W = 0.79
    checked = normality(men)
    assert checked.w == pytest.approx(0.7888147, abs=1e-6) and checked.p == pytest.approx(0.0067038, abs=1e-6)


def test_untestable_data_give_nan_and_no_test():
    assert math.isnan(normality([1, 2]).p) and math.isnan(normality([3, 3, 3, 3]).p)
    assert paired_t([1, 2], [2, 3]).variant == "paired t, two-sided: no test"
    assert welch_t([1], [2, 3]).variant == "Welch t, two-sided: no test"
    assert math.isnan(paired_power(float("nan"), 16, 0.05).observed)


def test_power_agrees_with_rs_pwr():
    # R, in statsmodels' tests: pwr.t.test(d = 1, n = 30, sig.level = 0.05, type = "paired")
    assert paired_power(1.0, 30 / EFFICIENCY, 0.05).observed == pytest.approx(0.9995636009612725, abs=1e-6)


def test_power_of_two_groups_is_that_of_the_noncentral_t():
    n = 20 * EFFICIENCY
    critical, shift, df = stats.t.ppf(0.975, 2 * n - 2), 0.5 * math.sqrt(n / 2), 2 * n - 2
    expected = stats.nct.sf(critical, df, shift) + stats.nct.cdf(-critical, df, shift)
    assert unpaired_power(0.5, 20, 20, 0.05).observed == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("d", [0.3, 0.5, 0.9])
def test_needed_participants_suffice_and_one_fewer_does_not(d):
    needed = int(paired_power(d, 16, 0.05).needed)
    assert paired_power(d, needed, 0.05).observed >= 0.8 > paired_power(d, needed - 1, 0.05).observed
    detectable = paired_power(d, 16, 0.05).detectable_d
    assert paired_power(detectable, 16, 0.05).observed == pytest.approx(0.8, abs=1e-6)


def test_a_comparison_has_all_statistics_and_is_none_without_values():
    found = compare(QUANTITIES[0], ("a", "b"), (SLEEP_1, SLEEP_2), paired=True, seed=1)
    assert found.t.d == pytest.approx(
        np.mean(np.subtract(SLEEP_2, SLEEP_1)) / np.std(np.subtract(SLEEP_2, SLEEP_1), ddof=1)
    )
    assert found.test.variant in [test.variant for test in found.variants]
    assert compare(QUANTITIES[0], ("a", "b"), ([], [1.0]), paired=False, seed=1) is None


# Hollander & Wolfe (1973), rounding first base by three methods, 22 players; R's ?friedman.test: 11.143, p = 0.003805.
ROUNDING = [
    (5.40, 5.50, 5.55), (5.85, 5.70, 5.75), (5.20, 5.60, 5.50), (5.55, 5.50, 5.40), (5.90, 5.85, 5.70),
    (5.45, 5.55, 5.60), (5.40, 5.40, 5.35), (5.45, 5.50, 5.35), (5.25, 5.15, 5.00), (5.85, 5.80, 5.70),
    (5.25, 5.20, 5.10), (5.65, 5.55, 5.45), (5.60, 5.35, 5.45), (5.05, 5.00, 4.95), (5.50, 5.50, 5.40),
    (5.45, 5.55, 5.50), (5.55, 5.55, 5.35), (5.45, 5.50, 5.55), (5.50, 5.45, 5.25), (5.65, 5.60, 5.40),
    (5.70, 5.65, 5.55), (6.30, 6.30, 6.25),
]  # fmt: skip


def test_omnibus_test_agrees_with_published_values():
    name, statistic, p = omnibus(list(zip(*ROUNDING, strict=True)), paired=True)
    assert name.startswith("Friedman")
    assert (statistic, p) == (pytest.approx(78 / 7, abs=1e-9), pytest.approx(math.exp(-39 / 7), abs=1e-9))
    assert math.isnan(omnibus([[1.0], [2.0], [3.0]], paired=False)[2])


def test_three_conditions_in_which_nobody_differs_have_no_test_and_no_warning():
    name, statistic, p = omnibus([[1.0, 2.0, 3.0, 4.0]] * 3, paired=True)
    assert name.endswith("no test") and math.isnan(statistic) and math.isnan(p)
