"""What runs without a hit mean: hit rates, and completion times with such runs ranked last."""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pandas as pd
from msgspec import Struct

from haptigraph.analysis.study.runs import condition_values
from haptigraph.analysis.study.statistics.effects import Effect, paired_effect, unpaired_effect
from haptigraph.analysis.study.statistics.hit_rate import HitRate, paired_hits, unpaired_hits
from haptigraph.analysis.study.statistics.rank_tests import RankTest, Zeros, rank_sum, signed_rank

__all__ = ["TimeoutAnalysis", "timeout_analyses", "worst_ranks"]


class TimeoutAnalysis(Struct, frozen=True):
    """One pair of conditions; not corrected for multiple tests."""

    first: str
    second: str
    hits: HitRate
    worst_rank: RankTest
    """Of completion time, with runs without a hit ranked last."""
    effect: Effect
    """Positive: the second condition is slower."""


def timeout_analyses(
    runs: pd.DataFrame, conditions: Sequence[str], *, paired: bool, zeros: Zeros, seed: int
) -> list[TimeoutAnalysis]:
    """Analyse every pair of conditions; return nothing if every run ended with a hit.

    Args:
        runs: The counted runs: participant, condition, outcome, completion_s.
        conditions: The effect is positive where the later one is slower.
        paired: Whether the same participants completed all of them.
        zeros: Treatment of pairs without a difference.
        seed: Of the bootstrap of large samples.
    """
    if (runs["outcome"] == "hit").all():
        return []
    scores = worst_ranks(runs).reindex(columns=list(conditions))
    hits = _table(runs.assign(hit=(runs["outcome"] == "hit").astype(float)), "hit", "min")
    found = []
    for first, second in combinations(conditions, 2):
        slow = condition_values(scores, first, second, paired=paired)
        did_hit = [
            [bool(each) for each in hit] for hit in condition_values(hits, first, second, paired=paired)
        ]
        if not slow[0] or not slow[1]:
            continue
        rates = (paired_hits if paired else unpaired_hits)(*did_hit)
        test = signed_rank(*slow, zeros=zeros) if paired else rank_sum(*slow)
        effect = (paired_effect if paired else unpaired_effect)(*slow, seed)
        found.append(TimeoutAnalysis(first, second, rates, test, effect))
    return found


def worst_ranks(runs: pd.DataFrame) -> pd.DataFrame:
    """Return a score of slowness per participant (rows) and condition (columns); only its order matters.

    A larger share of runs without a hit is worse than any time; equal shares are ordered by the mean time of
    the hits (worst-rank score: Lachin 1999, Controlled Clinical Trials 20). A difference in the share also
    ranks above any difference in time.
    """
    shares = _table(runs.assign(missed=(runs["outcome"] != "hit").astype(float)), "missed", "mean")
    times_s = _table(runs, "completion_s", "mean").fillna(0.0).where(shares.notna())
    worse_s = 2 * float(np.nanmax(times_s.to_numpy())) + 1.0
    return shares.stack().rank(method="dense").unstack().reindex_like(shares) * worse_s + times_s


def _table(runs: pd.DataFrame, column: str, how: str) -> pd.DataFrame:
    return runs.pivot_table(
        index="participant", columns="condition", values=column, aggfunc=how, dropna=False
    )
