"""The calibration of a study as tables: thresholds, patterns named correctly, and the confusion matrix."""

import math
from collections.abc import Iterator

import msgspec
import pandas as pd
from scipy.stats import binomtest

from haptigraph.analysis.study.tables import StudyTables
from haptigraph.study.preparation.calibration import Response, threshold_of

__all__ = ["calibration_paragraph", "calibration_tables"]


def calibration_tables(tables: StudyTables) -> dict[str, pd.DataFrame]:
    """Return the tables of the calibration by name; none without one. Withdrawn participants are left out.

    Intervals of proportions are those of each participant's presentations (95 %, Clopper and Pearson 1934).
    The confusion matrix counts the presentations of all; they are not independent, so it has no interval.
    """
    rows = tables.calibration[~tables.calibration["participant"].isin(tables.withdrawn)]
    rows = rows.sort_values(["participant", "device", "task", "number"])
    first = rows[(rows["task"] == "patterns") & (rows["round"] == 1)]
    found = {
        "thresholds": pd.DataFrame(list(_thresholds(rows[rows["task"] == "threshold"]))),
        "patterns_named": pd.DataFrame(list(_named(first))),
        "confusion": _confusion(first),
    }
    return {name: table for name, table in found.items() if not table.empty}


def calibration_paragraph(found: dict[str, pd.DataFrame]) -> str:
    """Describe the calibration for the methods; empty without one."""
    parts = []
    if "thresholds" in found:
        table = found["thresholds"]
        known = table[table["known"] == "yes"]
        parts.append(
            "Before the trials, the detection threshold of vibration amplitude was measured with yes/no "
            "answers (ZEST placement, King-Smith et al. 1994; Bayesian estimate over threshold, spread, "
            f"false alarms and lapses; one stimulus in five silent). It is known for {len(known)} "
            f"of {len(table)} participants and devices; {int(table['false_alarms'].sum())} of "
            f"{int(table['catch_trials'].sum())} silent stimuli were reported as felt."
        )
    if "patterns_named" in found:
        table = found["patterns_named"]
        parts.append(
            f"In the first round, participants named {int(table['correct'].sum())} of "
            f"{int(table['presented'].sum())} patterns correctly."
        )
    return " ".join(parts)


def _thresholds(rows: pd.DataFrame) -> Iterator[dict[str, object]]:
    for (participant, device), group in rows.groupby(["participant", "device"]):
        pairs = zip(group["amplitude"], group["response"], strict=True)
        found = threshold_of([Response("", float(amplitude), response) for amplitude, response in pairs])
        values = msgspec.structs.asdict(found)
        if not found.is_known:
            values |= dict.fromkeys(("amplitude", "low", "high", "sd_db"), math.nan)
        known = "yes" if found.is_known else "no"
        yield {"participant": participant, "device": device, **values, "known": known}


def _named(rows: pd.DataFrame) -> Iterator[dict[str, object]]:
    for (participant, device), group in rows.groupby(["participant", "device"]):
        correct, presented = int(group["correct"].sum()), len(group)
        interval = binomtest(correct, presented).proportion_ci(method="exact")
        yield {
            "participant": participant,
            "device": device,
            "presented": presented,
            "correct": correct,
            "share": correct / presented,
            "low": float(interval.low),
            "high": float(interval.high),
        }


def _confusion(rows: pd.DataFrame) -> pd.DataFrame:
    """Return how often each pattern (rows) was named as each (columns), with the share of each row."""
    if rows.empty:
        return rows
    counts = pd.crosstab(rows["pattern"], rows["response"])
    names = sorted(set(counts.index) | set(counts.columns))
    counts = counts.reindex(index=names, columns=names, fill_value=0)
    counts["presented"] = counts.sum(axis=1)
    counts["share_correct"] = [
        counts.loc[name, name] / total if total else float("nan")
        for name, total in counts["presented"].items()
    ]
    return counts.rename_axis(index="played", columns=None).reset_index()
