"""The methods section of a report: tests with their variants, versions, seeds and missing data."""

import platform
from importlib.metadata import version

from haptigraph.analysis.study.methods_estimates import effect_sizes, equivalence, runs_without_hit
from haptigraph.analysis.study.quantities import words
from haptigraph.analysis.study.results import StudyResults
from haptigraph.analysis.study.tables import StudyTables
from haptigraph.analysis.study.traces import Traces
from haptigraph.version import __version__

__all__ = ["SIMULATED", "methods"]

SIMULATED = "SIMULATED: no people took part"
LIBRARIES = ("numpy", "scipy", "statsmodels", "pandas", "matplotlib")


def methods(tables: StudyTables, results: StudyResults, traces: Traces, *, simulated: bool) -> list[str]:
    """Return the paragraphs of a paper's methods section."""
    parts = [
        _design(results, simulated=simulated),
        _tests(results),
        effect_sizes(results),
        equivalence(results),
        runs_without_hit(results),
        _sensitivity(results),
        _families(results),
        _order(results),
        _usability(results, simulated=simulated),
        _missing(tables, results, traces),
        _software(tables, results),
    ]
    return [part for part in parts if part]


def _design(results: StudyResults, *, simulated: bool) -> str:
    who = (
        f"{results.participants} simulated participants (no people took part)"
        if simulated
        else (f"{results.participants} participants")
    )
    kind = (
        "completed every condition (within-subject)"
        if results.is_within
        else "completed one condition each (between-subject)"
    )
    names = ", ".join(f"“{words(name)}”" for name in results.conditions)
    return (
        f"{who} {kind}: {names}. A run lasts from the tip's first entry into the globe to the first "
        "target hit. Training is excluded. Of repeated trials the last attempt is used; aborted, "
        "void and unfinished trials are excluded; a run without a hit has no completion time. The mean "
        "over a participant's runs in a condition is one observation."
    )


def _tests(results: StudyResults) -> str:
    comparisons = [each for family in results.families for each in family.comparisons]
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
    return (
        f"Conditions were compared by {tests}.{pairs} Values that agree to 12 digits are ties. All other "
        "variants are listed in rank_test_variants.csv."
    )


def _sensitivity(results: StudyResults) -> str:
    t, of = ("a paired t test", "the differences") if results.is_within else ("Welch's t test", "each sample")
    return (
        f"Normality of {of} was checked "
        f"by the Shapiro-Wilk test; {t} is reported as sensitivity analysis. Power is that of the "
        "t test with n multiplied by 3/π, the asymptotic relative efficiency of the rank test for a "
        "normal distribution; power at the observed effect is a function of the p-value, so the "
        "smallest effect detectable with 80 % power is reported with it."
    )


def _families(results: StudyResults) -> str:
    families = ", ".join(f"{family.about} ({len(family.comparisons)} tests)" for family in results.families)
    tests = sorted({each.variant for family in results.families for each in family.omnibus})
    omnibus = f" Omnibus tests of three or more conditions came first: {'; '.join(tests)}." if tests else ""
    return (
        f"The level of significance is {results.plan.alpha:g}, two-sided; p-values were corrected by "
        f"Holm's step-down method within each family: {families}.{omnibus}"
    )


def _order(results: StudyResults) -> str:
    if not results.is_within:
        return ""
    if not results.order:
        return "Order effects are confounded with those of the condition, as the order was the same for all."
    remarks = [f"{model.name}: {model.remark}" for model in results.order if model.remark]
    listed = f" ({'; '.join(remarks)})" if remarks else ""
    return (
        "Order and learning: linear mixed models with condition, position of the condition in the "
        "session and, where there are several, trial as fixed effects and a random intercept per "
        f"participant, fitted by REML; Wald tests with the normal distribution{listed}."
    )


def _usability(results: StudyResults, *, simulated: bool) -> str:
    if results.sus.empty:
        return ""
    random = " Simulated participants have no opinion: their answers are random." if simulated else ""
    partial = int(results.sus["sus"].isna().sum())
    return (
        "SUS was scored after Brooke (1996); grades and percentiles are those of the curved grading "
        "scale of Sauro and Lewis (2016), adjectives those of Bangor, Kortum and Miller (2009). "
        f"Incomplete questionnaires are not scored ({partial} of {len(results.sus)}).{random}"
    )


def _missing(tables: StudyTables, results: StudyResults, traces: Traces) -> str:
    counts = results.missing[["trials", "timeout", "aborted", "repeated"]].sum()
    comparisons = [each for family in results.families for each in family.comparisons]
    gaps = sorted({f"{each.quantity.label}: {each.left_out}" for each in comparisons if each.left_out})
    unpaired = f" Participants excluded for a missing pair: {', '.join(gaps)}." if gaps else ""
    erased = f", {len(tables.erased)} of them with all their data erased" if tables.erased else ""
    count = len(tables.withdrawn)
    withdrawn = f" Participants who withdrew and are excluded: {count}{erased}." if count else ""
    absent = f" Not recorded: {', '.join(results.absent)}." if results.absent else ""
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
