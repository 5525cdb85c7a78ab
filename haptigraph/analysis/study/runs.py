"""Which trials count, and what each participant did in each condition. Statistics see one value per cell."""

import pandas as pd

__all__ = ["cells", "condition_names", "counted_runs", "is_within", "missing_data", "values_of"]

RUN = ["participant", "condition", "block", "trial"]
NO_RUN = "aborted"


def counted_runs(trials: pd.DataFrame, phase: str = "trial") -> pd.DataFrame:
    """Return the runs that count: of each trial the last attempt, unless aborted, void or unfinished.

    A run that ended without a hit has no completion time (NaN), whatever the clock said.
    """
    runs = _last_attempts(trials[trials["phase"] == phase])
    runs = runs[runs["outcome"] != NO_RUN].copy()
    runs.loc[runs["outcome"] != "hit", "completion_s"] = float("nan")
    return runs.reset_index(drop=True)


def _last_attempts(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the last attempt of every trial; one that is void or has not ended counts as aborted."""
    keys = [key for key in RUN if key in trials]
    last = trials.sort_values([*keys, "attempt"], kind="stable").drop_duplicates(keys, keep="last").copy()
    void = last["void"].notna() if "void" in last else False
    last.loc[last["outcome"].isna() | void, "outcome"] = NO_RUN
    return last


def condition_names(trials: pd.DataFrame, listed: list[str], baseline: str | None = None) -> list[str]:
    """Return the conditions: the baseline, those that the protocol lists in its order, others by name."""
    places = {name: place for place, name in enumerate(listed)}
    names = set(trials["condition"])
    return sorted(names, key=lambda name: (name != baseline, places.get(name, len(places)), name))


def is_within(trials: pd.DataFrame) -> bool:
    """Whether participants met more than one condition."""
    return bool((trials.groupby("participant")["condition"].nunique() > 1).any())


def cells(runs: pd.DataFrame, column: str, conditions: list[str]) -> pd.DataFrame:
    """Return one value per participant (rows) and condition (columns): the mean of the runs that have one."""
    known = runs.dropna(subset=[column])
    table = known.pivot_table(index="participant", columns="condition", values=column, aggfunc="mean")
    return table.reindex(index=sorted(set(runs["participant"])), columns=conditions)


def values_of(
    table: pd.DataFrame, first: str, second: str, *, paired: bool
) -> tuple[list[float], list[float]]:
    """Return the values of two conditions; paired: only of participants who have both, in the same order."""
    if paired:
        table = table[[first, second]].dropna()
        return [float(value) for value in table[first]], [float(value) for value in table[second]]
    left, right = table[first].dropna(), table[second].dropna()
    return [float(value) for value in left], [float(value) for value in right]


def missing_data(trials: pd.DataFrame, conditions: list[str]) -> pd.DataFrame:
    """Count, by condition: participants, trials, hits, timeouts, aborted for good, and repeated attempts."""
    asked = trials[trials["phase"] == "trial"]
    last = _last_attempts(asked)
    rows = []
    for condition in conditions:
        here, all_here = last[last["condition"] == condition], asked[asked["condition"] == condition]
        outcomes = [int((here["outcome"] == outcome).sum()) for outcome in ("hit", "timeout", "aborted")]
        repeated = len(all_here) - len(here)
        rows.append((condition, here["participant"].nunique(), len(here), *outcomes, repeated))
    columns = ["condition", "participants", "trials", "hit", "timeout", "aborted", "repeated"]
    return pd.DataFrame(rows, columns=columns)
