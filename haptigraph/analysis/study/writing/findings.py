"""The first sentences of a report: what the data can show, and the result of each hypothesis."""

from collections.abc import Iterator

import pandas as pd

from haptigraph.analysis.study.preregistered.hypotheses import HypothesisResult, sentence
from haptigraph.analysis.study.results import StudyResults
from haptigraph.analysis.study.results_table import p_text
from haptigraph.analysis.study.statistics.exact import smallest_p
from haptigraph.analysis.words import counted
from haptigraph.study.plan import inseparable

__all__ = ["findings", "warnings"]


def findings(results: StudyResults) -> list[str]:
    """Return a sentence if the data are too few to show anything, and one for each hypothesis."""
    found = [*_limits(results), *(_result(results, each) for each in results.hypotheses)]
    if any(each.is_supported is False for each in results.hypotheses):
        found.append("A hypothesis that is not supported is not thereby refuted.")
    return found


def warnings(results: StudyResults, flagged: pd.DataFrame) -> list[str]:
    """Return what makes all results doubtful: a confounded design, and poor data.

    Args:
        results: The results.
        flagged: The runs beyond a threshold of data quality, with the column `analysed`.
    """
    found = []
    if "target" in results.runs:
        runs = results.runs.dropna(subset=["target"])
        titles = runs["condition"].map(results.titles)
        if listed := inseparable(zip(titles, runs["target"].astype(str), strict=True)):
            found.append(
                f"Condition cannot be separated from target: {listed}. A difference between conditions may "
                "be one between targets."
            )
    poor = int((flagged["analysed"] == "yes").sum())
    if poor:
        found.append(
            f"Data quality: {poor} of the {len(results.runs)} analysed runs are beyond a threshold of the "
            "protocol. Details lists them."
        )
    return found


def _limits(results: StudyResults) -> Iterator[str]:
    """Yield what so few participants can show at best."""
    comparisons = [each for family in results.families for each in family.comparisons]
    best = min(
        (smallest_p(*(sample.n for sample in each.samples), paired=each.is_paired) for each in comparisons),
        default=1.0,
    )
    if comparisons and best >= results.plan.alpha:
        yield (
            f"With {counted(results.participants, 'participant')} the smallest possible p is {best:.3g}: "
            "these data cannot show an effect."
        )


def _result(results: StudyResults, each: HypothesisResult) -> str:
    hypothesis = each.hypothesis
    claim = sentence(hypothesis, results.quantities[hypothesis.measure], results.titles)
    if each.is_supported is None:
        return f"{claim}: not tested, because there are {each.why_untested}."
    p = f"p = {p_text(each.holm_p)}".replace("= <", "< ")
    if each.is_supported:
        return f"{claim}: supported ({p} after Holm's correction)."
    return f"{claim}: not supported ({p} after Holm's correction)."
