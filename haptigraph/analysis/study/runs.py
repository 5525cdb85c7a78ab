"""Select the trials that are analysed, and average them to one value per participant and condition."""

import pandas as pd

__all__ = [
    "condition_names", "condition_values", "counted_runs", "is_within", "missing_data", "participant_means",
]  # fmt: skip

RUN = ["participant", "condition", "block", "trial"]
NO_RUN = "aborted"


def counted_runs(trials: pd.DataFrame, phase: str = "trial") -> pd.DataFrame:
    """Return the last attempt at each trial, unless aborted, void or unfinished.

    A run that ended without a hit has no completion time (NaN).
    """
    runs = _last_attempts(trials[trials["phase"] == phase])
    runs = runs[runs["outcome"] != NO_RUN].copy()
    runs.loc[runs["outcome"] != "hit", "completion_s"] = float("nan")
    return runs.reset_index(drop=True)


def _last_attempts(trials: pd.DataFrame) -> pd.DataFrame:
    """Return the last attempt at every trial; a void or unfinished one counts as aborted."""
    keys = [key for key in RUN if key in trials]
    last = trials.sort_values([*keys, "attempt"], kind="stable").drop_duplicates(keys, keep="last").copy()
    void = last["void"].notna() if "void" in last else False
    last.loc[last["outcome"].isna() | void, "outcome"] = NO_RUN
    return last


def condition_names(trials: pd.DataFrame, listed: list[str], baseline: str | None = None) -> list[str]:
    """Return the conditions: the baseline first, then in the protocol's order, others by name."""
    index = {name: number for number, name in enumerate(listed)}
    names = set(trials["condition"])
    return sorted(names, key=lambda name: (name != baseline, index.get(name, len(index)), name))


def is_within(trials: pd.DataFrame) -> bool:
    """Return whether any participant completed more than one condition."""
    return bool((trials.groupby("participant")["condition"].nunique() > 1).any())


def participant_means(runs: pd.DataFrame, column: str, conditions: list[str]) -> pd.DataFrame:
    """Return the mean over the runs with a value, per participant (rows) and condition (columns)."""
    valid = runs.dropna(subset=[column])
    table = valid.pivot_table(index="participant", columns="condition", values=column, aggfunc="mean")
    return table.reindex(index=sorted(set(runs["participant"])), columns=conditions)


def condition_values(
    table: pd.DataFrame, first: str, second: str, *, paired: bool
) -> tuple[list[float], list[float]]:
    """Return the values of two conditions; if paired, of the participants with both, in the same order."""
    if paired:
        table = table[[first, second]].dropna()
        return [float(value) for value in table[first]], [float(value) for value in table[second]]
    left, right = table[first].dropna(), table[second].dropna()
    return [float(value) for value in left], [float(value) for value in right]


def missing_data(trials: pd.DataFrame, conditions: list[str]) -> pd.DataFrame:
    """Count, by condition: participants, trials, hits, timeouts, aborted trials, and repeated attempts."""
    attempts = trials[trials["phase"] == "trial"]
    last = _last_attempts(attempts)
    rows = []
    for condition in conditions:
        here, all_here = last[last["condition"] == condition], attempts[attempts["condition"] == condition]
        outcomes = [int((here["outcome"] == outcome).sum()) for outcome in ("hit", "timeout", "aborted")]
        repeated = len(all_here) - len(here)
        rows.append((condition, here["participant"].nunique(), len(here), *outcomes, repeated))
    columns = ["condition", "participants", "trials", "hit", "timeout", "aborted", "repeated"]
    return pd.DataFrame(rows, columns=columns)
