"""The analysis of a study's tables: families of comparisons, order effects, SUS, missing data."""

from itertools import combinations

import pandas as pd
from msgspec import Struct
from msgspec.structs import replace

from haptigraph.analysis.study.preregistered.families import Family, Samples, families_of
from haptigraph.analysis.study.preregistered.hypotheses import HypothesisResult, decide, is_about
from haptigraph.analysis.study.preregistered.omissions import (
    absent_quantities,
    poor_runs,
    silent_conditions,
    too_few_trials,
)
from haptigraph.analysis.study.quantities import (
    QUANTITIES,
    Quantity,
    state_of,
    state_quantities,
    words,
)
from haptigraph.analysis.study.runs import (
    condition_names,
    condition_values,
    counted_runs,
    is_within,
    missing_data,
    participant_means,
)
from haptigraph.analysis.study.statistics.comparison import Comparison, compare
from haptigraph.analysis.study.statistics.order_effects import MixedModel, order_effects
from haptigraph.analysis.study.statistics.questionnaires import (
    score_quantities,
    score_questionnaire,
    scored_questionnaires,
    unscored_names,
)
from haptigraph.analysis.study.statistics.rank_tests import Zeros
from haptigraph.analysis.study.tables import StudyTables
from haptigraph.errors import BadInput, unknown_name
from haptigraph.study.frozen.analysis_plan import Analysis
from haptigraph.study.questionnaire import Questionnaire

DEFAULT_ALPHA = 0.05

__all__ = ["AnalysisPlan", "StudyResults", "analyse"]


class AnalysisPlan(Struct, frozen=True):
    """The options of an analysis, all of which the report states."""

    seed: int = 0
    given_alpha: float | None = None
    """Level of significance; None: the preregistered one, or 0.05."""
    zeros: Zeros = "dropped"
    baseline: str | None = None
    """The reference condition; None: the protocol's first, or the first by name."""
    preregistered: Analysis | None = None
    """What the frozen protocol decided before the data; `analyse` takes it from the tables."""

    @property
    def alpha(self) -> float:
        """Level of significance."""
        if self.given_alpha is not None:
            return self.given_alpha
        return self.preregistered.alpha if self.preregistered else DEFAULT_ALPHA

    def bounds_of(self, quantity: Quantity) -> tuple[float, float] | None:
        """Return the preregistered equivalence bounds of an outcome, in its unit: second minus first.

        They have the order of the protocol, as have the comparisons: another baseline is refused.
        """
        return self.preregistered.equivalence.get(quantity.name) if self.preregistered else None


class StudyResults(Struct, frozen=True):
    """The results of an analysis."""

    plan: AnalysisPlan
    titles: dict[str, str]
    """What people read for each condition."""
    is_within: bool
    participants: int
    runs: pd.DataFrame
    """The included runs, one per row."""
    values: dict[str, pd.DataFrame]
    """By quantity: one value per participant (rows) and condition (columns)."""
    families: list[Family]
    order: list[MixedModel]
    unmodelled: dict[str, str]
    """By label of a primary measure: why it has no mixed model."""
    questionnaires: list[Questionnaire]
    """Those that are scored."""
    unscored: list[str]
    """Names of the other questionnaires about a condition."""
    scores: dict[str, pd.DataFrame]
    """By name of a questionnaire: the scores of its sheets."""
    missing: pd.DataFrame
    excluded: list[str]
    """Participants with too few valid trials."""
    poor_trials: int
    """Number of trials that were excluded because of their data quality."""
    absent: dict[str, str]
    """By label of a quantity without any value: why."""
    untested: dict[str, list[str]]
    """By label of a quantity: conditions in which it is 0 by construction, so that it was not tested."""
    idle: list[str]
    """States in which no time was spent."""
    quantities: dict[str, Quantity]
    """All outcomes by name, with or without values."""
    hypotheses: list[HypothesisResult]
    """Decisions about the preregistered hypotheses; without a preregistered analysis there are none."""

    @property
    def conditions(self) -> list[str]:
        """Names of the conditions; the first is the reference."""
        return list(self.titles)

    def title_of(self, condition: str) -> str:
        """Return what people read for a condition."""
        return self.titles[condition]

    def is_confirmatory(self, comparison: Comparison) -> bool:
        """Return whether a comparison tests a preregistered hypothesis."""
        return any(is_about(each.hypothesis, comparison) for each in self.hypotheses)


def analyse(tables: StudyTables, plan: AnalysisPlan) -> StudyResults:
    """Analyse a study.

    Args:
        tables: The study's tables.
        plan: The options.

    Raises:
        BadInput: If fewer than two conditions have included runs, or an option contradicts what the frozen
            protocol decided.
    """
    plan = _with_protocol(plan, tables)
    protocol, analysis = tables.protocol, plan.preregistered
    trials = tables.trials[~tables.trials["participant"].isin(tables.withdrawn)]
    runs = counted_runs(trials)
    within, poor = is_within(runs), 0
    if analysis and analysis.exclude_poor_trials:
        is_poor = poor_runs(runs, protocol.quality)
        runs, poor = runs[~is_poor], int(is_poor.sum())
    attempts, minimum = trials[trials["phase"] == "trial"], analysis.min_trials if analysis else 0
    excluded = too_few_trials(attempts, runs, protocol.names, minimum, within=within)
    runs = runs[~runs["participant"].isin(excluded)].reset_index(drop=True)
    conditions = _conditions(runs, tables, plan, excluded)
    answers = tables.answers[~tables.answers["participant"].isin([*tables.withdrawn, *excluded])]
    questionnaires = scored_questionnaires(answers, protocol.questionnaires)
    scores = {each.name: score_questionnaire(answers, each) for each in questionnaires}
    quantities = _quantities(runs, questionnaires, analysis)
    values = _values(runs, scores, quantities, conditions)
    idle = [
        state_of(name) for name, table in values.items() if state_of(name) and not (table > 0).any().any()
    ]
    used = [each for each in quantities if each.name in values and state_of(each.name) not in idle]
    silent = {each.name: silent_conditions(each, values[each.name], protocol) for each in used}
    samples = Samples(values, conditions, within, silent)
    compared = [found for each in used for found in _comparisons(each, samples, plan)]
    hypotheses = decide(analysis, compared) if analysis else []
    order, unmodelled = _order(runs, scores, used, conditions) if within else ([], {})
    titles = protocol.titles()
    return StudyResults(
        plan=plan,
        titles={name: titles.get(name, words(name)) for name in conditions},
        is_within=within,
        participants=int(runs["participant"].nunique()),
        runs=runs,
        values=values,
        families=families_of(used, samples, compared, hypotheses, plan.alpha),
        order=order,
        unmodelled=unmodelled,
        questionnaires=questionnaires,
        unscored=unscored_names(answers, questionnaires),
        scores=scores,
        missing=missing_data(trials, conditions),
        excluded=excluded,
        poor_trials=poor,
        absent=absent_quantities(quantities, values, attempts),
        idle=idle,
        untested={each.label: silent[each.name] for each in used if silent[each.name]},
        quantities={each.name: each for each in quantities},
        hypotheses=hypotheses,
    )


def _with_protocol(plan: AnalysisPlan, tables: StudyTables) -> AnalysisPlan:
    """Return a plan with what the protocol decided."""
    analysis = tables.protocol.analysis
    if analysis and plan.given_alpha not in (None, analysis.alpha):
        found = f"alpha {plan.given_alpha:g} contradicts the preregistered {analysis.alpha:g}"
        raise BadInput(f"{found}; leave it out", tables.folder)
    first = tables.protocol.names[:1]
    if analysis and analysis.equivalence and plan.baseline not in (None, *first):
        found = f"baseline {plan.baseline!r} would turn the signs of the preregistered equivalence bounds"
        raise BadInput(f"{found}; leave it out", tables.folder)
    return replace(plan, preregistered=analysis)


def _conditions(
    runs: pd.DataFrame, tables: StudyTables, plan: AnalysisPlan, excluded: list[str]
) -> list[str]:
    conditions = condition_names(runs, tables.protocol.names, plan.baseline)
    if plan.baseline is not None and plan.baseline not in conditions:
        raise BadInput(unknown_name("condition", plan.baseline, conditions))
    if len(conditions) < 2:
        found = f"only {conditions[0]!r}" if conditions else "none"
        found += f" ({len(excluded)} participants have too few trials)" if excluded else ""
        raise BadInput(f"a comparison needs two conditions with completed runs; found {found}", tables.folder)
    return conditions


def _quantities(
    runs: pd.DataFrame, questionnaires: list[Questionnaire], analysis: Analysis | None
) -> list[Quantity]:
    """Return all outcomes; preregistered primary measures are in the first family."""
    found = [*QUANTITIES, *state_quantities(runs.columns), *score_quantities(questionnaires)]
    primary, hypotheses = (analysis.primary, analysis.hypotheses) if analysis else ((), ())
    missing = {each.measure for each in hypotheses} - {each.name for each in found}
    found += [Quantity(name, words(name), "", "secondary") for name in sorted(missing)]  # nobody has a value
    return [replace(each, family="primary") if each.name in primary else each for each in found]


def _values(
    runs: pd.DataFrame, scores: dict[str, pd.DataFrame], quantities: list[Quantity], conditions: list[str]
) -> dict[str, pd.DataFrame]:
    people, tables = sorted(set(runs["participant"])), {}
    for name in (each.name for each in quantities):
        found = next((table for table in (runs, *scores.values()) if name in table), None)
        if found is not None:
            tables[name] = participant_means(found, name, conditions).reindex(people)
    return {name: table for name, table in tables.items() if table.notna().any().any()}


def _comparisons(quantity: Quantity, samples: Samples, plan: AnalysisPlan) -> list[Comparison]:
    """Compare all pairs of conditions in which a quantity can vary."""
    table, within, compared = samples.values[quantity.name], samples.is_within, []
    for first, second in combinations(samples.conditions_of(quantity), 2):
        pair = condition_values(table, first, second, paired=within)
        left_out = int(table[[first, second]].isna().any(axis=1).sum()) if within else 0
        compared.append(
            compare(
                quantity,
                (first, second),
                pair,
                paired=within,
                seed=plan.seed,
                alpha=plan.alpha,
                zeros=plan.zeros,
                left_out=left_out,
            )
        )
    return [each for each in compared if each is not None]


def _order(
    runs: pd.DataFrame, scores: dict[str, pd.DataFrame], quantities: list[Quantity], conditions: list[str]
) -> tuple[list[MixedModel], dict[str, str]]:
    """Model the primary measures; also return why one has no model, by label."""
    models, reasons = [], {}
    for each in quantities:
        if each.family == "primary":
            found = next(table for table in (runs, *scores.values()) if each.name in table)
            model = order_effects(found, each, conditions)
            if isinstance(model, MixedModel):
                models.append(model)
            else:
                reasons[each.label] = model
    return models, reasons
