"""Find what an analysis leaves out, and why: measures, comparisons and participants."""

from collections.abc import Iterable

import pandas as pd

from haptigraph.analysis.study.preregistered.frozen import FrozenProtocol
from haptigraph.analysis.study.quantities import Quantity
from haptigraph.study.frozen.quality import Quality, quality_problems

__all__ = ["NO_HIT", "absent_quantities", "poor_runs", "silent_conditions", "too_few_trials"]

NO_HIT = "no run ended with a hit"


def absent_quantities(
    quantities: Iterable[Quantity], values: Iterable[str], trials: pd.DataFrame
) -> dict[str, str]:
    """Return, by label, why an outcome has no value.

    Args:
        quantities: The outcomes.
        values: Names of those with values.
        trials: The trials under conditions, training excluded.
    """
    names, has_hit = set(values), bool((trials["outcome"] == "hit").any())
    return {
        each.label: NO_HIT if each.name == "completion_s" and not has_hit else "not recorded"
        for each in quantities
        if each.name not in names
    }


def silent_conditions(quantity: Quantity, table: pd.DataFrame, protocol: FrozenProtocol) -> list[str]:
    """Return the conditions in which an outcome is 0 by construction.

    Those without haptic output, as the protocol says; without a protocol, those in which nobody has a value
    other than 0.

    Args:
        quantity: The outcome.
        table: Its values by participant (rows) and condition (columns).
        protocol: The frozen protocol.
    """
    if not quantity.needs_touch:
        return []
    has_touch = {each.name: each.touch is not False for each in protocol.conditions}
    return [name for name in table if not has_touch.get(name, bool((table[name].fillna(0) != 0).any()))]


def poor_runs(runs: pd.DataFrame, thresholds: Quality) -> pd.Series:
    """Return whether each run is beyond a threshold of data quality; one that was not measured is not."""
    is_poor = [bool(quality_problems(run, thresholds)) for run in runs.to_dict("records")]
    return pd.Series(is_poor, index=runs.index, dtype=bool)


def too_few_trials(
    trials: pd.DataFrame, runs: pd.DataFrame, conditions: list[str], minimum: int, *, within: bool
) -> list[str]:
    """Return the participants with fewer counted runs than a minimum under any of their conditions.

    Args:
        trials: All attempts at trials.
        runs: The counted runs.
        conditions: All conditions; with a between-subject design, everyone has one.
        minimum: Number of runs under a condition.
        within: Whether everyone should have all conditions.
    """
    people = sorted(set(trials["participant"]))
    counts = pd.crosstab(runs["participant"], runs["condition"]).reindex(
        index=people, columns=conditions, fill_value=0
    )
    least = counts.min(axis=1) if within else counts.max(axis=1)
    return [str(name) for name in least.index[least < minimum]]
