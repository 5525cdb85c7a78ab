"""Decide the preregistered hypotheses from the comparisons of a study.

Primary hypotheses are one family of Holm's correction, other preregistered ones a second. Exploratory tests
are corrected apart from both, so their number has no effect on a confirmatory result.
"""

import math
from collections.abc import Sequence

from msgspec import Struct
from msgspec.structs import replace
from statsmodels.stats.multitest import multipletests

from haptigraph.analysis.study.quantities import Quantity
from haptigraph.analysis.study.statistics.comparison import Comparison
from haptigraph.study.frozen.analysis_plan import Analysis, Hypothesis

__all__ = ["HypothesisResult", "decide", "holm_corrected", "is_about", "sentence"]

VERBS = {
    "different": "differs",
    "smaller": "is smaller",
    "greater": "is greater",
    "equivalent": "is equivalent",
}


class HypothesisResult(Struct, frozen=True):
    """The decision about one preregistered hypothesis."""

    hypothesis: Hypothesis
    is_primary: bool
    bounds: tuple[float, float] | None
    """Of equivalence, where it is claimed."""
    test: str
    """Its variant; "": none."""
    p: float
    """Two-sided, or of an equivalence; NaN without a test."""
    holm_p: float
    """Corrected over the hypotheses of its family, in which one without a test has p = 1."""
    is_supported: bool | None
    """Significant after the correction, and in the expected direction; None without a test."""
    why_untested: str = ""


def is_about(hypothesis: Hypothesis, comparison: Comparison) -> bool:
    """Return whether a comparison tests a hypothesis about a difference."""
    pair = {comparison.first, comparison.second}
    is_pair = pair == {hypothesis.first, hypothesis.second}
    return is_pair and hypothesis.measure == comparison.quantity.name and hypothesis.expect != "equivalent"


def decide(analysis: Analysis, comparisons: Sequence[Comparison]) -> list[HypothesisResult]:
    """Return the decisions about all preregistered hypotheses."""
    found = [_tested(each, analysis, comparisons) for each in analysis.hypotheses]
    decided: dict[int, HypothesisResult] = {}
    for is_primary in (True, False):
        family = [number for number, each in enumerate(found) if each.is_primary == is_primary]
        holm = holm_corrected([found[number].p for number in family], analysis.alpha)
        for number, p in zip(family, holm, strict=True):
            each = found[number]
            supported = None if each.is_supported is None else each.is_supported and p < analysis.alpha
            decided[number] = replace(each, holm_p=p, is_supported=supported)
    return [decided[number] for number in range(len(found))]


def holm_corrected(p: Sequence[float], alpha: float) -> list[float]:
    """Correct p-values by Holm's step-down method; NaN stays, and counts as a hypothesis with p = 1."""
    if not p:
        return []
    corrected = multipletests([1.0 if math.isnan(each) else each for each in p], alpha, method="holm")[1]
    return [
        math.nan if math.isnan(before) else float(after) for before, after in zip(p, corrected, strict=True)
    ]


def sentence(hypothesis: Hypothesis, quantity: Quantity, titles: dict[str, str]) -> str:
    """Return a hypothesis in words; titles of conditions are by name."""
    first, second = (f"“{titles.get(name, name)}”" for name in (hypothesis.first, hypothesis.second))
    than = {"different": "from", "equivalent": "to"}.get(hypothesis.expect, "than")
    return f"{quantity.label} with {second} {VERBS[hypothesis.expect]} {than} that with {first}"


def _tested(
    hypothesis: Hypothesis, analysis: Analysis, comparisons: Sequence[Comparison]
) -> HypothesisResult:
    """Return a hypothesis with its test; `is_supported` is about its direction alone."""
    is_primary = hypothesis.measure in analysis.primary
    if hypothesis.expect == "equivalent":
        return _equivalence_tested(hypothesis, analysis, comparisons)
    tested = next((each for each in comparisons if is_about(hypothesis, each)), None)
    if tested is None:
        why = "no values to compare"
        return HypothesisResult(hypothesis, is_primary, None, "", math.nan, math.nan, None, why)
    rise = tested.effect.r if tested.second == hypothesis.second else -tested.effect.r
    expected = {"smaller": rise < 0, "greater": rise > 0}.get(hypothesis.expect, True)
    return HypothesisResult(
        hypothesis, is_primary, None, tested.test.variant, tested.test.p, math.nan, expected
    )


def _equivalence_tested(
    hypothesis: Hypothesis, analysis: Analysis, comparisons: Sequence[Comparison]
) -> HypothesisResult:
    is_primary, bounds = hypothesis.measure in analysis.primary, analysis.equivalence[hypothesis.measure]
    about = hypothesis.measure, hypothesis.first, hypothesis.second
    tested = next(
        (each.equivalence for each in comparisons if (each.quantity.name, each.first, each.second) == about),
        None,
    )
    if tested is None:
        why = "no values to compare"
        return HypothesisResult(hypothesis, is_primary, bounds, "", math.nan, math.nan, None, why)
    return HypothesisResult(hypothesis, is_primary, bounds, tested.variant, tested.p, math.nan, True)
