"""Summarise a sweep: compare conditions and estimate the sample size that a study needs.

Reports no p-values: with thousands of simulated participants every difference is significant.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from haptigraph.analysis.study.quantities import QUANTITIES
from haptigraph.analysis.study.runs import condition_values, counted_runs, is_within, participant_means
from haptigraph.analysis.study.statistics.sensitivity import paired_power, paired_t, unpaired_power, welch_t

__all__ = ["markdown", "sweep_summary", "trials_table"]

MEASURES = ("completion_s", "mean_theta_deg")


def trials_table(rows: Sequence[Mapping[str, Any]]) -> pd.DataFrame:
    """Return all trials as a table; absent values are missing."""
    return pd.DataFrame(list(rows))


def sweep_summary(trials: pd.DataFrame, conditions: list[str], alpha: float = 0.05) -> pd.DataFrame:
    """Compare the first condition with every other one, under each variation.

    Args:
        trials: As `trials_table` returns them.
        conditions: In the protocol's order.
        alpha: Level of significance of the planned study.

    Returns:
        A row per variation, measure and pair; `needed` is the sample size for 80 % power, as in a report.
    """
    lines = []
    for variation in dict.fromkeys(trials["variation"]):
        here = counted_runs(trials[trials["variation"] == variation])
        paired = is_within(here)
        for quantity in (each for each in QUANTITIES if each.name in MEASURES):
            table = participant_means(here, quantity.name, conditions)
            for other in conditions[1:]:
                first, second = condition_values(table, conditions[0], other, paired=paired)
                tested = (paired_t if paired else welch_t)(first, second)
                power = (
                    paired_power(tested.d, len(first), alpha)
                    if paired
                    else unpaired_power(tested.d, len(first), len(second), alpha)
                )
                lines.append(
                    {
                        "variation": variation,
                        "measure": quantity.label,
                        "first": conditions[0],
                        "second": other,
                        "n": len(first) if paired else len(first) + len(second),
                        **_sample("first", first),
                        **_sample("second", second),
                        "difference": tested.difference,
                        "low": tested.low,
                        "high": tested.high,
                        "d": tested.d,
                        "needed": power.needed,
                    }
                )
    return pd.DataFrame(lines)


def markdown(summary: pd.DataFrame) -> str:
    """Return a summary as Markdown."""
    head = ["variation", "measure", "compared", "n", "first", "second", "difference (95 %)", "d", "needed"]
    lines = ["SIMULATED: no people took part", "", _line(head), _line(["---"] * len(head))]
    for row in summary.to_dict("records"):
        lines.append(
            _line(
                [
                    str(row["variation"]),
                    str(row["measure"]),
                    f"{row['first']} → {row['second']}",
                    str(row["n"]),
                    f"{row['first_mean']:.2f} ± {row['first_sd']:.2f}",
                    f"{row['second_mean']:.2f} ± {row['second_sd']:.2f}",
                    f"{row['difference']:+.2f} ({row['low']:+.2f} to {row['high']:+.2f})",
                    f"{row['d']:+.2f}",
                    "" if pd.isna(row["needed"]) else f"{row['needed']:.0f}",
                ]
            )
        )
    return "\n".join(lines) + "\n"


def _sample(name: str, values: list[float]) -> dict[str, float]:
    series = pd.Series(values, dtype=float)
    return {f"{name}_mean": float(series.mean()), f"{name}_sd": float(series.std())}


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
