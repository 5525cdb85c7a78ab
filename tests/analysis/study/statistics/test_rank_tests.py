import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from haptigraph.analysis.study.statistics.rank_tests import (
    every_rank_sum,
    every_signed_rank,
    rank_sum,
    signed_rank,
)

# Hollander & Wolfe (1973), Hamilton depression scale, 9 patients; R's ?wilcox.test: V = 40, one-sided p = 0.01953.
BEFORE = [1.83, 0.50, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.30]
AFTER = [0.878, 0.647, 0.598, 2.05, 1.06, 1.29, 1.06, 3.14, 1.29]
# Darwin's maize (Fisher 1935); SciPy's documentation of wilcoxon: 24.0, p = 0.041259765625.
MAIZE = [6, 8, 14, 16, 23, 24, 28, 29, 41, -48, 49, 56, 60, -67, 75]
# Student's sleep data (Cushny & Peebles 1905), one zero and one tie; R: V = 0, p-value = 0.009091.
SLEEP_1 = [0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0]
SLEEP_2 = [1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4]
# R, in SciPy's tests: wilcox.test(x, y, paired = TRUE, exact = FALSE, correct = FALSE / TRUE).
R_X = [120, 114, 181, 188, 180, 146, 121, 191, 132, 113, 127, 112]
R_Y = [133, 143, 119, 189, 112, 199, 198, 113, 115, 121, 142, 187]
# SciPy's tests: 56 differences with 8 zeros and many ties.
COUNTED = np.repeat(range(-4, 5), [1, 4, 16, 15, 8, 4, 5, 1, 2]).astype(float)


def test_nine_pairs_agree_with_published_values():
    test = signed_rank(AFTER, BEFORE)
    assert (test.statistic, test.opposite) == (40.0, 5.0)
    assert test.p == pytest.approx(2 * 0.01953125, abs=1e-12)
    assert test.variant == "Wilcoxon signed-rank, two-sided, exact"


def test_darwins_maize_agrees_with_published_values():
    test = signed_rank(np.zeros(15), MAIZE)
    assert min(test.statistic, test.opposite) == 24.0
    assert test.p == pytest.approx(0.041259765625, abs=1e-12)


@pytest.mark.parametrize(("continuity", "p"), [(False, 0.6948866), (True, 0.7240817)])
def test_approximation_agrees_with_r(continuity, p):
    assert signed_rank(R_X, R_Y, exact=False, continuity=continuity).p == pytest.approx(p, abs=1e-6)


@pytest.mark.parametrize(("continuity", "p"), [(False, 0.001565402), (True, 0.001904195)])
def test_ties_agree_with_r(continuity, p):
    test = signed_rank(np.zeros(10), np.full(10, 0.1), exact=False, continuity=continuity)
    assert test.p == pytest.approx(p, abs=1e-6)
    assert test.ties == 10 and "tie correction (10 tied)" in test.variant


@pytest.mark.parametrize(("zeros", "p"), [("pratt", 0.0031724568006762576), ("dropped", 0.00641346115861)])
def test_zeros_agree_with_scipys_reference(zeros, p):
    test = signed_rank(np.zeros(len(COUNTED)), COUNTED, zeros=zeros, exact=False, continuity=False)
    assert test.p == pytest.approx(p, abs=1e-6)
    assert test.zeros == 8


def test_a_zero_and_a_tie_among_ten_pairs_in_every_variant():
    variants = {test.variant: test.p for test in every_signed_rank(SLEEP_1, SLEEP_2)}
    approximation = "normal approximation with continuity correction, tie correction (2 tied), 1 zero dropped"
    assert variants[f"Wilcoxon signed-rank, two-sided, {approximation}"] == pytest.approx(
        0.009090698, abs=1e-6
    )
    exact = [p for variant, p in variants.items() if "exact over mid-ranks (2 tied)" in variant]
    assert exact == [pytest.approx(2 / 2**9)] * 2  # all nine rise: one sign pattern of 512, and its mirror
    assert len(variants) == 6 and sum("Pratt" in variant for variant in variants) == 3


def test_differences_that_differ_only_by_rounding_are_tied():
    test = signed_rank([0.1, 0.2, 0.5], [0.3, 0.4, 0.1])  # 0.3 - 0.1 is not 0.4 - 0.2
    assert test.ties == 2


def test_no_difference_is_no_evidence():
    test = signed_rank([1, 2, 3], [1, 2, 3])
    assert test.p == 1.0 and test.zeros == 3 and test.variant.endswith("no test")


def enumerated(difference: list[int], zeros: str) -> float:
    """Return the two-sided p by enumerating all sign patterns."""
    moved = np.array([each for each in difference if each], float)
    ranks = (
        stats.rankdata(np.abs(difference))[np.array(difference) != 0]
        if zeros == "pratt"
        else stats.rankdata(abs(moved))
    )
    found = ranks[moved > 0].sum()
    sums = np.array([np.dot(ranks, signs) for signs in itertools.product((0, 1), repeat=len(ranks))])
    return min(1.0, 2 * min((sums <= found).mean(), (sums >= found).mean()))


@given(
    st.lists(st.integers(-4, 4), min_size=1, max_size=8).filter(any), st.sampled_from(["dropped", "pratt"])
)
def test_exact_p_counts_every_sign_pattern(difference, zeros):
    test = signed_rank(np.zeros(len(difference)), difference, zeros=zeros)
    assert test.p == pytest.approx(enumerated(difference, zeros), abs=1e-12)


@given(st.lists(st.integers(-6, 6), min_size=1, max_size=7).filter(any))
def test_swapping_the_conditions_swaps_the_sums_and_keeps_p(difference):
    zeros = np.zeros(len(difference))
    there, back = signed_rank(zeros, difference), signed_rank(difference, zeros)
    assert (there.statistic, there.opposite, there.p) == (
        back.opposite,
        back.statistic,
        pytest.approx(back.p),
    )


def test_two_samples_agree_with_published_values():
    # Hollander & Wolfe (1973), permeability of the placenta; R's ?wilcox.test: W = 35, one-sided p = 0.1272.
    term = [0.80, 0.83, 1.89, 1.04, 1.45, 1.38, 1.91, 1.64, 0.73, 1.46]
    early = [1.15, 0.88, 0.90, 0.74, 1.21]
    test = rank_sum(early, term)
    assert (test.statistic, test.opposite) == (35.0, 15.0)
    assert test.p == pytest.approx(2 * 382 / 3003, abs=1e-12)  # 0.1272061 of choose(15, 5)


def test_diabetes_example_agrees_with_scipys_documentation():
    males, females = [19, 22, 16, 29, 24], [20, 11, 17, 12]
    exact, corrected, _, summed = every_rank_sum(females, males)
    assert "exact, twice the smaller tail" in exact.variant and summed.p == pytest.approx(exact.p)
    assert exact.statistic == 17.0 and exact.p == pytest.approx(0.1111111111111111, abs=1e-12)
    assert corrected.p == pytest.approx(0.11134688653314041, abs=1e-9)


@given(
    st.lists(st.integers(0, 3), min_size=1, max_size=4), st.lists(st.integers(0, 3), min_size=1, max_size=4)
)
def test_exact_p_of_two_samples_counts_every_choice(first, second):
    test = rank_sum(first, second)
    ranks = stats.rankdata([*first, *second])
    sums = np.array([sum(chosen) for chosen in itertools.combinations(ranks, len(second))])
    found = ranks[len(first) :].sum()
    assert test.p == pytest.approx(
        min(1.0, 2 * min((sums <= found + 1e-9).mean(), (sums >= found - 1e-9).mean()))
    )


def test_both_ways_to_a_two_sided_p_of_a_skewed_distribution_are_named():
    # Mid-ranks 2.5, 2.5, 2.5, 2.5 of four and 5 of one: sums of two are 5 (six of ten ways) and 7.5 (four).
    doubled, *_, summed = every_rank_sum([1, 1, 1], [1, 2])
    assert (doubled.p, summed.p) == (pytest.approx(0.8), pytest.approx(0.4))
    assert "twice the smaller tail" in doubled.variant and "both tails summed" in summed.variant
    assert len({test.variant for test in every_rank_sum([1, 1, 1], [1, 2])}) == 4


def test_large_samples_use_the_named_approximation():
    rng = np.random.default_rng(1)
    first, second = rng.normal(size=60), rng.normal(0.3, size=60)
    assert "normal approximation with continuity correction" in signed_rank(first, second).variant
    assert len(every_signed_rank(first, second)) == 2
    assert "normal approximation" in rank_sum(first, second).variant
