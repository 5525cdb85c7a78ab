import builtins

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from touch_trials import holm, signed_rank

from haptigraph.errors import MissingExtra


def test_holm_agrees_with_a_worked_example():
    # Wright 1992, Biometrics 48: sorted p-values times m, m - 1, ..., made to rise
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.6, 0.9]) == pytest.approx([1.0, 1.0])
    assert holm([]) == []


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8))
def test_holm_never_lowers_and_keeps_the_order(p_values):
    corrected = holm(p_values)
    assert all(after >= before for before, after in zip(p_values, corrected, strict=True))
    assert np.array_equal(np.argsort(p_values, kind="stable"), np.argsort(corrected, kind="stable")) or len(
        set(corrected)
    ) < len(corrected)


@pytest.fixture
def scipy():
    return pytest.importorskip("scipy")


def test_the_signed_rank_test_agrees_with_a_worked_example(scipy):
    # Hollander and Wolfe, Nonparametric Statistical Methods: Hamilton depression scores; T+ = 40 of 45, and
    # two-sided p = 0.0391 (one-sided 0.0195), also in R's wilcox.test example.
    first = [1.83, 0.50, 1.62, 2.48, 1.68, 1.88, 1.55, 3.06, 1.30]
    second = [0.878, 0.647, 0.598, 2.05, 1.06, 1.29, 1.06, 3.14, 1.29]
    result = signed_rank(first, second)
    assert (result.pairs, result.zeros, result.statistic, result.variant) == (9, 0, 5.0, "exact")
    assert result.p == pytest.approx(0.0390625)
    assert result.effect == pytest.approx(-(40 - 5) / 45)


def test_ties_are_counted_by_all_signs_and_zeros_dropped(scipy):
    result = signed_rank([0, 0, 0, 0, 0, 0], [1, 1, 1, -1, 2, 0])
    assert (result.zeros, result.variant) == (1, "exact over all signs, mid-ranks")
    # mid-ranks 2.5 (four times) and 5; the smaller sum is 2.5: 5 of the 32 sign patterns lie as far down
    assert result.statistic == 2.5
    assert result.p == pytest.approx(10 / 32)


def test_ties_made_by_rounding_are_ties(scipy):
    assert signed_rank([0.1, 0.2, 0.5], [0.3, 0.4, 0.8]).variant == "exact over all signs, mid-ranks"


def test_many_tied_pairs_say_that_p_is_approximate(scipy):
    assert signed_rank([0] * 30, [1] * 20 + [-1] * 10).variant.startswith("normal")


def test_no_difference_at_all_is_told_as_such(scipy):
    result = signed_rank([1, 2, 3], [1, 2, 3])
    assert (result.p, result.effect, result.variant) == (1.0, 0.0, "no pair differs")


def test_without_scipy_the_extra_is_named(monkeypatch):
    def refuse(name, *args, real=builtins.__import__):
        if name.partition(".")[0] == "scipy":
            raise ImportError(name)
        return real(name, *args)

    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(MissingExtra, match=r"haptigraph\[analysis\]"):
        signed_rank([1.0], [2.0])
