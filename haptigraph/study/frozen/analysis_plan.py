"""The [analysis] table of a protocol: hypotheses, level of significance, equivalence bounds and exclusions.

It is frozen with the protocol, so it was decided before the data; what it names is confirmatory.
"""

from collections.abc import Collection, Iterator, Sequence
from typing import Annotated, Literal

from msgspec import Meta, Struct, field

from haptigraph.errors import unknown_name
from haptigraph.study.data_dictionary import TRIAL_MEASURES
from haptigraph.study.frozen.quality import Quality, quality_limits
from haptigraph.toml_document import Document

__all__ = ["Analysis", "Hypothesis", "check_analysis", "numeric_measures"]

Alpha = Annotated[float, Meta(gt=0, le=0.5)]

NO_OUTCOMES = ("delivered_s", "weakest_amplitude")  # they describe the equipment


class Hypothesis(Struct, frozen=True, forbid_unknown_fields=True):
    """One [[analysis.hypothesis]]: how a measure differs between two conditions."""

    measure: str
    """A measure of trials, or the score of a questionnaire."""
    first: str
    second: str
    """Conditions."""
    expect: Literal["different", "smaller", "greater", "equivalent"] = "different"
    """The second condition's values, compared with the first's."""


class Analysis(Struct, frozen=True, forbid_unknown_fields=True):
    """The [analysis] table."""

    primary: tuple[str, ...]
    """Primary measures. Hypotheses about them are corrected together, all others apart from them."""
    hypotheses: tuple[Hypothesis, ...] = field(name="hypothesis")
    alpha: Alpha = 0.05
    """Level of significance."""
    equivalence: dict[str, tuple[float, float]] = {}
    """By measure: the bounds of a difference that is as good as none, later minus earlier condition."""
    exclude_poor_trials: bool = False
    """Whether trials beyond a threshold of [quality] are excluded."""
    min_trials: Annotated[int, Meta(ge=0, le=1000)] = 0
    """Participants with fewer remaining trials under a condition are excluded."""


def numeric_measures(states: Collection[str], scores: Collection[str]) -> list[str]:
    """Return the measures that a hypothesis can be about.

    Args:
        states: Of the protocol's procedures.
        scores: Of the questionnaires after each condition.
    """
    measured = [each.name for each in TRIAL_MEASURES if each.kind != "text" and each.name not in NO_OUTCOMES]
    return [*measured, *(f"time_{state}_s" for state in states), *scores]


def check_analysis(
    document: Document,
    analysis: Analysis,
    conditions: Sequence[str],
    measures: Collection[str],
    trials: int,
    quality: Quality,
) -> None:
    """Check an [analysis] table.

    Args:
        document: The protocol.
        analysis: Its table.
        conditions: Names of its conditions, in its order.
        measures: Those that it records.
        trials: Number of trials under each condition.
        quality: Its thresholds.

    Raises:
        BadInput: At the first problem, with its line.
    """
    problems = list(_unknown_measures(analysis, measures))
    for number, hypothesis in enumerate(analysis.hypotheses):
        if hypothesis in analysis.hypotheses[:number]:
            problems.append((f"hypothesis[{number}]", "the same hypothesis twice; remove one of them"))
        found = _hypothesis_problems(hypothesis, analysis.equivalence, conditions, measures)
        problems += [(f"hypothesis[{number}].{key}", problem) for key, problem in found]
    problems += _problems(analysis, trials)  # last, as a misspelt name may cause them
    if analysis.exclude_poor_trials and not quality_limits(quality):
        problems.append(("exclude_poor_trials", "[quality] sets no threshold; set one, or remove the key"))
    for key, problem in problems:
        raise document.error(problem, f"analysis.{key}")


def _unknown_measures(analysis: Analysis, measures: Collection[str]) -> Iterator[tuple[str, str]]:
    """Yield keys and problems of names outside of hypotheses."""
    named = [(f"primary[{number}]", name) for number, name in enumerate(analysis.primary)]
    named += [(f"equivalence.{name}", name) for name in analysis.equivalence]
    return ((key, unknown_name("measure", name, measures)) for key, name in named if name not in measures)


def _problems(analysis: Analysis, trials: int) -> Iterator[tuple[str, str]]:
    """Yield keys and problems."""
    if not analysis.primary:
        yield "primary", "primary is empty; name one measure or more"
    tested = [each.measure for each in analysis.hypotheses]
    for number, name in enumerate(analysis.primary):
        if name not in tested:
            yield (
                f"primary[{number}]",
                f"no [[analysis.hypothesis]] is about {name!r}; add one, or remove it from primary",
            )
    for name, (low, high) in analysis.equivalence.items():
        if not low < 0 < high:
            found = f"found {low:g} and {high:g}"
            yield f"equivalence.{name}", f"{name}: expected a bound below 0 and one above 0, {found}"
    if analysis.min_trials > trials:
        most = f"expected at most {trials}, the trials under a condition"
        yield "min_trials", f"min_trials = {analysis.min_trials} excludes everyone; {most}"


def _hypothesis_problems(
    hypothesis: Hypothesis,
    bounds: Collection[str],
    conditions: Sequence[str],
    measures: Collection[str],
) -> Iterator[tuple[str, str]]:
    """Yield keys and problems; `bounds` are the measures with equivalence bounds."""
    if hypothesis.measure not in measures:
        yield "measure", unknown_name("measure", hypothesis.measure, measures)
    for key in ("first", "second"):
        if (name := getattr(hypothesis, key)) not in conditions:
            yield key, unknown_name("condition", name, conditions)
    order = [name for name in conditions if name in (hypothesis.first, hypothesis.second)]
    if hypothesis.first == hypothesis.second:
        yield "second", f"{hypothesis.first!r} is compared with itself; name two conditions"
    elif hypothesis.expect == "equivalent" and order != [hypothesis.first, hypothesis.second]:
        yield (
            "first",
            "name the conditions of an equivalence in the order of the protocol, as its bounds have signs",
        )
    if hypothesis.expect == "equivalent" and hypothesis.measure not in bounds:
        valid = f"add equivalence = {{{hypothesis.measure} = [LOW, HIGH]}} to [analysis]"
        yield "expect", f"{hypothesis.measure} has no equivalence bounds; {valid}"
