"""The methods section of a report: tests with their variants, versions, seeds and missing data."""

import math
import platform
from collections.abc import Iterator
from importlib.metadata import version

from haptigraph.analysis.study.data_quality import quality_paragraph
from haptigraph.analysis.study.preregistered.hypotheses import HypothesisResult, sentence
from haptigraph.analysis.study.preregistered.omissions import NO_HIT
from haptigraph.analysis.study.quantities import words
from haptigraph.analysis.study.results import StudyResults
from haptigraph.analysis.study.tables import StudyTables
from haptigraph.analysis.study.traces import Traces
from haptigraph.analysis.study.writing.estimates import effect_sizes, equivalence, runs_without_hit
from haptigraph.analysis.study.writing.protocol import protocol_paragraph
from haptigraph.analysis.words import counted
from haptigraph.study.questionnaire import Questionnaire
from haptigraph.version import __version__

__all__ = ["SIMULATED", "methods", "preregistered"]

SIMULATED = "SIMULATED: no people took part"
FACTORS = {
    "position": "that of the condition in the session",
    "sequence": "the condition that came first",
    "after": "the condition before",
}
LIBRARIES = ("numpy", "scipy", "statsmodels", "pandas", "matplotlib")


def methods(tables: StudyTables, results: StudyResults, traces: Traces, *, simulated: bool) -> list[str]:
    """Return the paragraphs of a paper's methods section."""
    parts = [
        _design(results, simulated=simulated),
        preregistered(results),
        protocol_paragraph(tables, results),
        _tests(results),
        effect_sizes(results),
        equivalence(results),
        runs_without_hit(results),
        _sensitivity(results),
        _families(results),
        _order(results),
        *_questionnaires(results, simulated=simulated),
        _missing(tables, results, traces),
        quality_paragraph(tables, results),
        _software(tables, results),
    ]
    return [part for part in parts if part]


def preregistered(results: StudyResults) -> str:
    """Return what was decided before the data, and what is exploratory."""
    analysis = results.plan.preregistered
    if analysis is None:
        return "Exploratory: no analysis was preregistered in the protocol, so every test is exploratory."
    labels = ", ".join(results.quantities[name].label for name in analysis.primary)
    counts = [sum(each.is_primary == primary for each in results.hypotheses) for primary in (True, False)]
    untested = [
        f"{_sentence(results, each)} ({each.why_untested})"
        for each in results.hypotheses
        if each.is_supported is None
    ]
    without = f" Not tested, and counted with p = 1: {'; '.join(untested)}." if untested else ""
    rules = []
    if analysis.exclude_poor_trials:
        rules.append(f"trials beyond a threshold of data quality ({results.poor_trials})")
    if analysis.min_trials:
        few = (
            "no valid trial" if analysis.min_trials == 1 else f"fewer than {analysis.min_trials} valid trials"
        )
        fewest = f"{few} under a condition"
        rules.append(f"participants with {fewest} ({len(results.excluded)})")
    excluded = (
        f" Excluded as preregistered: {', '.join(rules)}." if rules else " Nothing is excluded by rule."
    )
    hypotheses = "hypothesis" if counts[1] == 1 else "hypotheses"
    return (
        f"Confirmatory: the protocol, frozen with the first participant, preregistered {counts[0]} primary "
        f"({labels}) and {counts[1]} other {hypotheses}; each group was corrected by Holm's method. A "
        "hypothesis is supported if its corrected two-sided p-value is below the level of significance and "
        f"the effect has the expected direction. All other tests are exploratory.{without}{excluded}"
    )


def _sentence(results: StudyResults, result: HypothesisResult) -> str:
    hypothesis = result.hypothesis
    return sentence(hypothesis, results.quantities[hypothesis.measure], results.titles)


def _design(results: StudyResults, *, simulated: bool) -> str:
    people = counted(results.participants, "simulated participant" if simulated else "participant")
    who = f"{people} (no people took part)" if simulated else people
    runs = results.runs
    complete = int((runs.groupby("participant")["condition"].nunique() == len(results.conditions)).sum())
    kind = (
        f"within-subject design; {complete} of them completed a run under every condition"
        if results.is_within
        else "each completed one condition (between-subject)"
    )
    names = ", ".join(f"“{title}”" for title in results.titles.values())
    return (
        f"{who}, {kind}: {names}. A run lasts from the tip's first entry into the globe to the first "
        "target hit, or to the trial's end. Training is excluded. Of repeated trials the last attempt is "
        "used; aborted, void and unfinished trials are excluded; a run without a hit has no completion time. "
        "The mean over a participant's runs in a condition is one observation."
    )


def _tests(results: StudyResults) -> str:
    comparisons = [each for family in results.families for each in family.comparisons]
    if not comparisons:
        return "No conditions could be compared, because no measure has values under two of them."
    used = {
        variant: sorted({each.quantity.label for each in comparisons if each.test.variant == variant})
        for variant in sorted({each.test.variant for each in comparisons})
    }
    tests = "; ".join(f"{variant} ({', '.join(labels)})" for variant, labels in used.items())
    zeros = (
        "dropped before ranking (Wilcoxon 1945)"
        if results.plan.zeros == "dropped"
        else "ranked first (Pratt 1959)"
    )
    pairs = f" Pairs without a difference are {zeros}." if results.is_within else ""
    untested = "; ".join(
        f"{label} ({', '.join(f'“{results.title_of(name)}”' for name in conditions)})"
        for label, conditions in results.untested.items()
    )
    silent = (
        f" Not compared, as they are 0 by construction without haptic output: {untested}." if untested else ""
    )
    return (
        f"Conditions were compared by {tests}.{pairs} Values that agree to 12 digits are ties. All other "
        f"variants are listed in rank_test_variants.csv.{silent}"
    )


def _sensitivity(results: StudyResults) -> str:
    t, of = ("a paired t test", "the differences") if results.is_within else ("Welch's t test", "each sample")
    comparisons = [each for family in results.families for each in family.comparisons]
    has_power = any(math.isfinite(each.power.detectable_d) for each in comparisons)
    power = (
        "Power is that of the t test with n multiplied by 3/π, the asymptotic relative efficiency of the "
        "rank test for a normal distribution; power at the observed effect is a function of the p-value, so "
        "the smallest effect detectable with 80 % power is reported with it."
        if has_power
        else "Power is not reported, because there are too few values."
    )
    return (
        f"Normality of {of} was checked by the Shapiro-Wilk test; {t} is reported as sensitivity analysis. "
        f"{power}"
    )


def _families(results: StudyResults) -> str:
    families = ", ".join(
        f"{family.about} ({counted(family.explored, 'test')})"
        for family in results.families
        if family.explored
    )
    tests = sorted({each.variant for family in results.families for each in family.omnibus})
    omnibus = f" Omnibus tests of three or more conditions came first: {'; '.join(tests)}." if tests else ""
    exploratory = "exploratory " if results.hypotheses else ""
    corrected = (
        f"; {exploratory}p-values were corrected by Holm's step-down method within each family: {families}"
        if families
        else ""
    )
    return f"The level of significance is {results.plan.alpha:g}, two-sided{corrected}.{omnibus}"


def _order(results: StudyResults) -> str:
    if not results.is_within:
        return ""
    formulas: dict[str, list[str]] = {}
    for model in results.order:
        label = results.quantities[model.name].label
        remark = f", but {model.remark}" if model.remark else ""
        formulas.setdefault(model.formula.removeprefix("value ~ "), []).append(f"{label}{remark}")
    models = "; ".join(f"{formula} ({', '.join(labels)})" for formula, labels in formulas.items())
    used = [name for name in FACTORS if any(name in formula.split(" + ") for formula in formulas)]
    meanings = ", ".join(f"{name} is {FACTORS[name]}" for name in used)
    about = (
        "Order, learning and target" if any("target" in each for each in formulas) else "Order and learning"
    )
    fitted = (
        f"{about}: linear mixed models with a random intercept per participant, fitted by "
        f"REML; fixed effects: {models}, where {meanings}. The t tests have Satterthwaite's degrees of "
        "freedom."
        if models
        else "Order and learning were not modelled."
    )
    left_out = "; ".join(
        f"{', '.join(model.dropped)} ({results.quantities[model.name].label})"
        for model in results.order
        if model.dropped
    )
    reasons = "; ".join(f"{label}: {reason}" for label, reason in results.unmodelled.items())
    parts = [fitted, left_out and f"Left out: {left_out}.", reasons and f"No model: {reasons}."]
    return " ".join(part for part in parts if part)


def _questionnaires(results: StudyResults, *, simulated: bool) -> Iterator[str]:
    random = " Simulated participants have no opinion: their answers are random." if simulated else ""
    for each in results.questionnaires:
        sheets = results.scores[each.name]
        partial = int(sheets[each.name].isna().sum())
        yield f"{_scoring(each)} Incomplete sheets have no score ({partial} of {len(sheets)}).{random}"
    if results.unscored:
        yield f"Not scored, as they define no score: {', '.join(results.unscored)}."


def _scoring(questionnaire: Questionnaire) -> str:
    if questionnaire.name == "sus":
        return (
            "SUS was scored after Brooke (1996); grades and percentiles are those of the curved grading "
            "scale of Sauro and Lewis (2016), adjectives those of Bangor, Kortum and Miller (2009)."
        )
    scoring = questionnaire.score
    if scoring is None:
        return ""
    total, *subscales = questionnaire.scales
    turned = f", {counted(len(scoring.reversed), 'item')} reversed" if scoring.reversed else ""
    weighted = "weighted " if scoring.weights else ""
    parts = f"; subscales: {', '.join(each.title for each in subscales)}" if subscales else ""
    source = f" ({questionnaire.source})" if questionnaire.source else ""
    return (
        f"{total.title} is the {weighted}{scoring.method} of {counted(len(total.items), 'item')}{turned}, "
        f"from {total.low:g} to {total.high:g}{parts}{source}."
    )


def _missing(tables: StudyTables, results: StudyResults, traces: Traces) -> str:
    counts = results.missing[["trials", "timeout", "aborted", "repeated"]].sum()
    comparisons = [each for family in results.families for each in family.comparisons]
    gaps = sorted({f"{each.quantity.label}: {each.left_out}" for each in comparisons if each.left_out})
    unpaired = f" Participants excluded for a missing pair: {', '.join(gaps)}." if gaps else ""
    erased = f", {len(tables.erased)} of them with all their data erased" if tables.erased else ""
    count = len(tables.withdrawn)
    withdrawn = f" Participants who withdrew and are excluded: {count}{erased}." if count else ""
    unrecorded = [label for label, why in results.absent.items() if why != NO_HIT]
    absent = f" Not recorded: {', '.join(unrecorded)}." if unrecorded else ""
    without = [label for label, why in results.absent.items() if why == NO_HIT]
    if without:
        absent += f" No value of {', '.join(without)}, as {NO_HIT}."
    idle = (
        f" No time was spent in: {', '.join(words(state) for state in results.idle)}." if results.idle else ""
    )
    runs = f" Recordings: {len(traces.runs)} runs read, {traces.absent} files missing." if traces.runs else ""
    return (
        f"Missing data: of {counts['trials']} trials, {counts['timeout']} ended without a hit and "
        f"{counts['aborted']} were aborted, void or unfinished; {counts['repeated']} attempts were "
        f"repeated.{withdrawn}{unpaired}{absent}{idle}{runs} No data were imputed."
    )


def _software(tables: StudyTables, results: StudyResults) -> str:
    libraries = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    recorded = tables.trials["software"].dropna() if "software" in tables.trials else []
    by = (
        f" Runs were recorded by haptigraph {', '.join(sorted(set(map(str, recorded))))}."
        if len(recorded)
        else ""
    )
    digests = "; ".join(f"{name} {digest}" for name, digest in sorted(tables.sha256.items()))
    return (
        f"Analysed by haptigraph {__version__} with Python {platform.python_version()}, "
        f"{libraries}; seed {results.plan.seed}.{by} SHA-256 of the tables: {digests}."
    )
