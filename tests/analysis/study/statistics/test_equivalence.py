import math

import numpy as np
import pytest

from haptigraph.analysis.study.quantities import QUANTITIES
from haptigraph.analysis.study.statistics.comparison import compare
from haptigraph.analysis.study.statistics.equivalence import equivalence
from haptigraph.analysis.study.statistics.rank_tests import signed_rank
from haptigraph.errors import BadInput

FIRST = [61.0, 72.5, 80.0, 66.0, 90.5, 77.0, 68.0, 83.0]
SECOND = [62.5, 71.0, 82.0, 65.5, 91.0, 79.5, 67.0, 84.0]


def test_equivalence_is_the_larger_of_both_one_sided_p_values():
    found = equivalence(FIRST, SECOND, -1.5, 2.0, paired=True)
    difference = np.subtract(SECOND, FIRST)
    signs = np.array(np.meshgrid(*[(0, 1)] * 8)).reshape(8, -1)

    def one_sided(values):
        ranks = np.abs(values)[:, None] >= np.abs(values)
        ranks = ranks.sum(1) - (np.abs(values)[:, None] == np.abs(values)).sum(1) / 2 + 0.5
        moved = values != 0
        ranks = (ranks - (~moved).sum()) * moved
        return np.mean(ranks @ signs >= ranks[values > 0].sum() - 1e-9)

    assert found.p == pytest.approx(max(one_sided(difference + 1.5), one_sided(2.0 - difference)), abs=1e-12)
    assert found.is_shown == (found.p < 0.05)


def test_a_large_p_value_is_no_equivalence():
    first, second = [60, 75, 90, 70, 85, 65], [75, 62, 86, 88, 69, 77]
    assert signed_rank(first, second).p > 0.5
    assert not equivalence(first, second, -3, 3, paired=True).is_shown
    assert equivalence(first, second, -40, 40, paired=True).is_shown


@pytest.mark.parametrize("paired", [True, False])
@pytest.mark.parametrize("n", [12, 60])
def test_equivalence_is_shown_where_the_90_percent_interval_is_within_the_bounds(n, paired):
    rng = np.random.default_rng(n)
    first = rng.normal(size=n)
    second = first + rng.normal(0.1, 0.5, n) if paired else rng.normal(0.1, 1, n)
    inner = equivalence(first, second, -9, 9, paired=paired)
    for wider in (0.001, -0.001):
        found = equivalence(first, second, inner.low - wider, inner.high + wider, paired=paired)
        assert found.is_shown == (wider > 0)
    assert inner.p_t < 0.001 and inner.variant.startswith("TOST by")


def test_bounds_in_the_wrong_order_are_refused_and_constant_values_have_no_t_test():
    with pytest.raises(BadInput, match="lower bound below the upper one; found 2 and -2"):
        equivalence(FIRST, SECOND, 2, -2, paired=True)
    same = equivalence([1.0] * 8, [1.0] * 8, -1, 1, paired=True)
    assert math.isnan(same.p_t) and same.is_shown and same.estimate == 0
    assert not equivalence([1.0], [1.0], -1, 1, paired=False).is_shown


def test_without_bounds_a_comparison_has_no_equivalence():
    without = compare(QUANTITIES[0], ("a", "b"), (FIRST, SECOND), paired=True, seed=0)
    within = compare(QUANTITIES[0], ("a", "b"), (FIRST, SECOND), paired=True, seed=0, bounds=(-5, 5))
    assert without.equivalence is None and within.equivalence.is_shown
