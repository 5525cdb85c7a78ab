"""The analysis of a study's tables: families of comparisons, order effects, SUS, missing data."""

from itertools import combinations

import pandas as pd
from msgspec import Struct
from statsmodels.stats.multitest import multipletests

from haptigraph.analysis.study.quantities import FAMILIES, QUANTITIES, Quantity, state_of, state_quantities
from haptigraph.analysis.study.runs import (
    condition_names,
    condition_values,
    counted_runs,
    is_within,
    missing_data,
    participant_means,
)
from haptigraph.analysis.study.statistics.comparison import Comparison, compare, omnibus
from haptigraph.analysis.study.statistics.order_effects import MixedModel, order_effects
from haptigraph.analysis.study.statistics.rank_tests import Zeros
from haptigraph.analysis.study.statistics.sus import sus_scores
from haptigraph.analysis.study.statistics.timeouts import TimeoutAnalysis, timeout_analyses
from haptigraph.analysis.study.tables import StudyTables
from haptigraph.errors import BadInput, unknown_name

__all__ = ["AnalysisPlan", "Family", "Omnibus", "StudyResults", "analyse"]


class AnalysisPlan(Struct, frozen=True):
    """The options of an analysis, all of which the report states."""

    seed: int = 0
    alpha: float = 0.05
    zeros: Zeros = "dropped"
    baseline: str | None = None
    """The reference condition; None: the protocol's first, or the first by name."""
    bounds: dict[str, tuple[float, float]] = {}
    """By quantity: preregistered bounds of equivalence."""

    def bounds_of(self, quantity: Quantity) -> tuple[float, float] | None:
        """Return the preregistered equivalence bounds of an outcome, in its unit: second minus first."""
        return self.bounds.get(quantity.name)


class Omnibus(Struct, frozen=True):
    """An omnibus test of three or more conditions."""

    quantity: Quantity
    variant: str
    statistic: float
    p: float


class Family(Struct, frozen=True):
    """Hypotheses that are corrected together."""

    name: str
    about: str
    comparisons: list[Comparison]
    holm: list[float]
    """p-values corrected by Holm's step-down method, one per comparison."""
    omnibus: list[Omnibus]


class StudyResults(Struct, frozen=True):
    """The results of an analysis."""

    plan: AnalysisPlan
    conditions: list[str]
    is_within: bool
    participants: int
    runs: pd.DataFrame
    """The included runs, one per row."""
    values: dict[str, pd.DataFrame]
    """By quantity: one value per participant (rows) and condition (columns)."""
    families: list[Family]
    order: list[MixedModel]
    sus: pd.DataFrame
    missing: pd.DataFrame
    absent: list[str]
    """Quantities without any value."""
    idle: list[str]
    """States in which no time was spent."""
    timeouts: list[TimeoutAnalysis]
    """By pair of conditions; empty if every run ended with a hit."""


def analyse(tables: StudyTables, plan: AnalysisPlan) -> StudyResults:
    """Analyse a study.

    Args:
        tables: The study's tables.
        plan: The options.

    Raises:
        BadInput: If fewer than two conditions have included runs.
    """
    trials = tables.trials[~tables.trials["participant"].isin(tables.withdrawn)]
    runs = counted_runs(trials)
    conditions = condition_names(runs, tables.protocol_conditions, plan.baseline)
    if plan.baseline is not None and plan.baseline not in conditions:
        raise BadInput(unknown_name("condition", plan.baseline, conditions))
    if len(conditions) < 2:
        found = f"only {conditions[0]!r}" if conditions else "none"
        raise BadInput(f"a comparison needs two conditions with completed runs; found {found}", tables.folder)
    sus = sus_scores(tables.answers[~tables.answers["participant"].isin(tables.withdrawn)])
    values = _values(runs, sus, conditions)
    idle = [
        state_of(name) for name, table in values.items() if state_of(name) and not (table > 0).any().any()
    ]
    quantities = [*QUANTITIES, *state_quantities(runs.columns)]
    used = [each for each in quantities if each.name in values and state_of(each.name) not in idle]
    within = is_within(runs)
    families = [
        _family(name, about, [each for each in used if each.family == name], values, conditions, within, plan)
        for name, about in FAMILIES.items()
    ]
    return StudyResults(
        plan=plan,
        conditions=conditions,
        is_within=within,
        participants=int(runs["participant"].nunique()),
        runs=runs,
        values=values,
        families=[family for family in families if family.comparisons],
        order=_order(runs, sus, used, conditions) if within else [],
        sus=sus,
        missing=missing_data(trials, conditions),
        absent=[each.label for each in quantities if each.name not in values],
        idle=idle,
        timeouts=timeout_analyses(runs, conditions, paired=within, zeros=plan.zeros, seed=plan.seed),
    )


def _values(runs: pd.DataFrame, sus: pd.DataFrame, conditions: list[str]) -> dict[str, pd.DataFrame]:
    columns = [each.name for each in (*QUANTITIES, *state_quantities(runs.columns)) if each.name in runs]
    tables = {name: participant_means(runs, name, conditions) for name in columns}
    if not sus.empty:
        tables["sus"] = participant_means(sus, "sus", conditions).reindex(sorted(set(runs["participant"])))
    return {name: table for name, table in tables.items() if table.notna().any().any()}


def _family(
    name: str,
    about: str,
    quantities: list[Quantity],
    values: dict[str, pd.DataFrame],
    conditions: list[str],
    within: bool,
    plan: AnalysisPlan,
) -> Family:
    compared, tested = [], []
    for quantity in quantities:
        table = values[quantity.name]
        for first, second in combinations(conditions, 2):
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
                    bounds=plan.bounds_of(quantity),
                )
            )
        if len(conditions) > 2:
            whole = table.dropna() if within else table
            samples = [[float(value) for value in whole[each].dropna()] for each in conditions]
            if all(samples):
                tested.append(Omnibus(quantity, *omnibus(samples, paired=within)))
    done = [each for each in compared if each is not None]
    holm = multipletests([each.test.p for each in done], plan.alpha, method="holm")[1] if done else []
    return Family(name, about, done, [float(p) for p in holm], tested)


def _order(
    runs: pd.DataFrame, sus: pd.DataFrame, quantities: list[Quantity], conditions: list[str]
) -> list[MixedModel]:
    primary = [each for each in quantities if each.family == "primary"]
    models = [order_effects(sus if each.name == "sus" else runs, each, conditions) for each in primary]
    return [model for model in models if model is not None]
