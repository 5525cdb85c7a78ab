"""The data quality of the counted runs: by condition, beyond the protocol's thresholds, and in words."""

import pandas as pd

from haptigraph.analysis.study.results import StudyResults
from haptigraph.analysis.study.runs import counted_runs
from haptigraph.analysis.study.tables import StudyTables
from haptigraph.study.frozen.quality import is_unrecorded, quality_limits, quality_problems

__all__ = ["flagged_trials", "quality_by_condition", "quality_paragraph"]

KEY = ["participant", "condition", "block", "trial", "attempt"]
SUMMARIES = {
    "images_per_s": ("median", "min"),
    "late_images_fraction": ("median", "max"),
    "skipped_images": ("sum",),
    "unseen_fraction": ("median", "max"),
    "long_gaps": ("sum",),
    "longest_gap_s": ("max",),
}


def quality_by_condition(tables: StudyTables) -> pd.DataFrame:
    """Return statistics of the measures of quality, one row per condition; empty if none was recorded."""
    runs = _runs(tables)
    if not _is_recorded(runs):
        return pd.DataFrame()
    summaries = {name: statistics for name, statistics in SUMMARIES.items() if name in runs}
    grouped = runs.groupby("condition")
    columns = {
        f"{name}_{statistic}": grouped[name].agg(statistic)
        for name, statistics in summaries.items()
        for statistic in statistics
    }
    recorded = grouped["images_per_s"].count()
    return pd.DataFrame({"runs": grouped.size(), "recorded": recorded, **columns}).reset_index()


def flagged_trials(tables: StudyTables, results: StudyResults) -> pd.DataFrame:
    """Return the trials beyond a threshold: which, what is beyond it, and whether they are analysed."""
    runs = _runs(tables)
    keys = [key for key in KEY if key in runs]
    analysed = set(results.runs[keys].itertuples(index=False, name=None))
    rows = []
    for run in runs.to_dict("records"):
        key = tuple(run[name] for name in keys)
        problems = quality_problems(run, tables.protocol.quality)
        if problems:
            rows.append((*key, "; ".join(problems), "yes" if key in analysed else "no"))
    return pd.DataFrame(rows, columns=[*keys, "problem", "analysed"])


def quality_paragraph(tables: StudyTables, results: StudyResults) -> str:
    """Return the methods' paragraph on the quality of the data."""
    runs, limits = _runs(tables), quality_limits(tables.protocol.quality)
    if not _is_recorded(runs):
        return "Data quality: not recorded."
    rates = runs["images_per_s"].dropna()
    facts = f"the median of {len(rates)} runs is {rates.median():.3g} images/s, the lowest {rates.min():.3g}"
    if not limits:
        return f"Data quality: {facts}. The protocol sets no thresholds, so no trial is flagged."
    flagged = flagged_trials(tables, results)
    analysed = int((flagged["analysed"] == "yes").sum())
    unrecorded = sum(is_unrecorded(run, tables.protocol.quality) for run in runs.to_dict("records"))
    return (
        f"Data quality: {facts}. The protocol's thresholds are {', '.join(limits)}. Beyond them: "
        f"{len(flagged)} of {len(runs)} runs, {analysed} of them analysed"
        + (f"; {unrecorded} could not be judged, as their quality was not recorded." if unrecorded else ".")
    )


def _is_recorded(runs: pd.DataFrame) -> bool:
    return "images_per_s" in runs and bool(runs["images_per_s"].notna().any())


def _runs(tables: StudyTables) -> pd.DataFrame:
    return counted_runs(tables.trials[~tables.trials["participant"].isin(tables.withdrawn)])
