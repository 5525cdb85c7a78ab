"""Paragraphs of the methods section on effect sizes, equivalence and runs without a hit."""

from haptigraph.analysis.study.results import StudyResults
from haptigraph.analysis.study.statistics.effects import RESAMPLES
from haptigraph.analysis.study.statistics.exact import EXACT_UP_TO
from haptigraph.analysis.study.statistics.intervals import WIDENED_ABOVE

__all__ = ["effect_sizes", "equivalence", "runs_without_hit"]


def effect_sizes(results: StudyResults) -> str:
    """Return how effect sizes and differences were estimated, and which have no interval."""
    r, differences = (
        ("the matched-pairs rank-biserial correlation (Kerby 2014)", "the Walsh averages of the differences")
        if results.is_within
        else ("the rank-biserial correlation (Cliff's delta)", "all differences between the two samples")
    )
    comparisons = [each for family in results.families for each in family.comparisons]
    large = any("bootstrap" in each.effect.variant for each in comparisons)
    bootstrap = (
        f"; beyond {EXACT_UP_TO} values it is bootstrapped (bias-corrected accelerated, "
        f"{RESAMPLES} resamples, seed {results.plan.seed})"
        if large
        else ""
    )
    missing = sorted({each.quantity.label for each in comparisons if "no interval" in each.effect.variant})
    without = (
        f" No interval is given where even the most extreme ranks would have p > 0.05: {', '.join(missing)}."
        if missing
        else ""
    )
    return (
        f"Effect size is {r}, positive where the second condition has the larger values. Its 95 % interval "
        "inverts the exact test over exponentially tilted ranks; above "
        f"{WIDENED_ABOVE} values it is widened to that of Fisher's z where this is wider{bootstrap}.{without}"
        f" The difference in units is the Hodges-Lehmann estimate, the median of {differences}, with the "
        "95 % interval of the rank test."
    )


def equivalence(results: StudyResults) -> str:
    """Return how equivalence was tested, or that it was not."""
    found = [
        (each.quantity, each.equivalence)
        for family in results.families
        for each in family.comparisons
        if each.equivalence is not None
    ]
    if not found:
        return (
            "No bounds of equivalence were preregistered, so equivalence was not tested: a large p-value is "
            "no evidence that two conditions are alike."
        )
    bounds = sorted(
        {f"{each.label} {test.bound_low:g} to {test.bound_high:g} {each.unit}" for each, test in found}
    )
    variants = sorted({test.variant for _, test in found})
    return (
        "Equivalence within preregistered bounds of the difference (second minus first) was tested by two "
        f"one-sided tests (Schuirmann 1987), each at {results.plan.alpha:g}: {'; '.join(bounds)}. "
        f"{'; '.join(variants)}. The t tests of the same hypotheses are in equivalence.csv."
    )


def runs_without_hit(results: StudyResults) -> str:
    """Return how hit rates were compared, and how such runs enter the sensitivity analysis."""
    if not results.timeouts:
        return "Every counted run ended with a hit, so hit rates were not compared."
    tests = "; ".join(sorted({each.hits.variant for each in results.timeouts}))
    return (
        f"Hit rate: participants who hit the target in all their runs were counted and compared ({tests}). "
        "Sensitivity analysis of completion time: runs without a hit were ranked last (Lachin 1999); "
        "participants are ordered by the share of such runs, then by the mean time of their hits. These "
        "p-values are not corrected for multiple tests."
    )
