import math

import pandas as pd
import pytest

from haptigraph.analysis.study.statistics.hit_rate import paired_hits, unpaired_hits
from haptigraph.analysis.study.statistics.timeouts import timeout_analyses, worst_ranks


def runs(rows) -> pd.DataFrame:
    frame = pd.DataFrame(rows, columns=["participant", "condition", "outcome", "completion_s"])
    return frame.assign(completion_s=frame["completion_s"].where(frame["outcome"] == "hit"))


def test_mcnemars_test_counts_those_who_hit_in_one_condition_alone():
    first = [True] * 4 + [False] * 6
    found = paired_hits(first, [True] * 10)
    assert found.p == pytest.approx(2 / 2**6) and (found.only_first, found.only_second) == (0, 6)
    assert found.odds_ratio == found.high == math.inf
    assert found.low == pytest.approx(0.025 ** (1 / 6) / (1 - 0.025 ** (1 / 6)))  # Clopper and Pearson
    alike = paired_hits([True, False], [True, False])
    assert alike.p == 1 and alike.variant.endswith("no test") and math.isnan(alike.low)


def test_fishers_test_agrees_with_r():
    found = unpaired_hits([True] * 9 + [False], [True] * 5 + [False] * 5)
    assert found.p == pytest.approx(0.140866873, abs=1e-8)  # R: fisher.test(rbind(c(5, 5), c(9, 1)))
    assert found.odds_ratio == pytest.approx(0.124716, abs=1e-4)
    assert (found.low, found.high) == pytest.approx((0.002127, 1.565839), abs=1e-4)
    assert unpaired_hits([True] * 3, [True] * 2).variant.endswith("no test")


def test_a_timeout_is_worse_than_the_slowest_hit_and_more_timeouts_are_worse_still():
    scores = worst_ranks(runs([
        ("A", "x", "hit", 10), ("A", "x", "hit", 30), ("B", "x", "hit", 900), ("B", "x", "hit", 100),
        ("C", "x", "hit", 1), ("C", "x", "timeout", 0), ("D", "x", "timeout", 0), ("D", "x", "timeout", 0),
        ("E", "x", "hit", 2), ("E", "x", "timeout", 0), ("A", "y", "hit", 5),
    ]))  # fmt: skip
    assert list(scores["x"].sort_values().index) == ["A", "B", "C", "E", "D"]
    gaps = [
        abs(scores.loc[one, "x"] - scores.loc[other, "x"])
        for one, other in (("B", "C"), ("C", "D"), ("A", "B"))
    ]
    assert min(gaps[:2]) > gaps[2] and math.isnan(scores.loc["B", "y"])


@pytest.mark.parametrize("paired", [True, False])
def test_timeouts_in_one_condition_are_found_though_the_remaining_times_are_equal(paired):
    people = [f"P{number}" for number in range(12)]
    rows = [(who, "first", "hit", 50 + number) for number, who in enumerate(people)]
    second = people if paired else [f"Q{number}" for number in range(12)]
    rows += [
        (who, "second", "timeout" if number < 8 else "hit", 50 + number) for number, who in enumerate(second)
    ]
    (found,) = timeout_analyses(runs(rows), ["first", "second"], paired=paired, zeros="dropped", seed=0)
    assert found.worst_rank.p < 0.02 and found.effect.low > 0
    assert (found.hits.hits_first, found.hits.hits_second) == (12, 4) and found.hits.p < 0.01
    assert ("McNemar" if paired else "Fisher") in found.hits.variant
    hits = runs([(who, name, "hit", 1) for who in people for name in ("first", "second")])
    assert timeout_analyses(hits, ["first", "second"], paired=True, zeros="dropped", seed=0) == []
