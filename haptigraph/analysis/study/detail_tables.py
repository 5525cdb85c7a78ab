"""Detailed results as data frames for the CSV files and the page: one row per test, variant, term, score."""

from collections.abc import Iterator

import msgspec
import pandas as pd

from haptigraph.analysis.study.figures.states import transitions
from haptigraph.analysis.study.results import StudyResults
from haptigraph.analysis.study.statistics.comparison import Comparison
from haptigraph.analysis.study.statistics.sus import adjective, grade

__all__ = ["detail_tables", "sus_summary"]

T_COLUMNS = ("t", "df", "p", "difference", "d", "variant")  # without the interval, which covers too little


def detail_tables(results: StudyResults) -> dict[str, pd.DataFrame]:
    """Return every table by the name of its file."""
    tables = {
        "comparisons": pd.DataFrame(list(_comparisons(results))),
        "rank_test_variants": pd.DataFrame(list(_variants(results))),
        "equivalence": pd.DataFrame(list(_equivalence(results))),
        "hit_rate": pd.DataFrame(list(_hit_rates(results))),
        "worst_rank": pd.DataFrame(list(_worst_ranks(results))),
        "omnibus": pd.DataFrame(list(_omnibus(results))),
        "order_effects": pd.DataFrame(list(_terms(results))),
        "hypotheses": pd.DataFrame(list(_hypotheses(results))),
        "questionnaires": _scores(results),
        "questionnaires_summary": _score_summary(results),
        "sus": _graded(results.scores["sus"]) if "sus" in results.scores else pd.DataFrame(),
        "sus_summary": sus_summary(results),
        "missing": results.missing,
        "participants_by_condition": _long(results),
        "state_transitions": transitions(results),
    }
    return {name: table for name, table in tables.items() if not table.empty}


def _comparisons(results: StudyResults) -> Iterator[dict[str, object]]:
    for family in results.families:
        for each, holm in zip(family.comparisons, family.holm, strict=True):
            yield {
                **_names(family.name, each),
                **{f"{name}_first": value for name, value in msgspec.structs.asdict(each.samples[0]).items()},
                **{
                    f"{name}_second": value for name, value in msgspec.structs.asdict(each.samples[1]).items()
                },
                "left_out": each.left_out,
                "test": each.test.variant,
                "statistic": each.test.statistic,
                "statistic_opposite": each.test.opposite,
                "zeros": each.test.zeros,
                "tied": each.test.ties,
                "p": each.test.p,
                "p_holm": holm,
                "status": "confirmatory" if results.is_confirmatory(each) else "exploratory",
                "r": each.effect.r,
                "r_low": each.effect.low,
                "r_high": each.effect.high,
                "effect": each.effect.variant,
                "shift": each.shift.estimate,
                "shift_low": each.shift.low,
                "shift_high": each.shift.high,
                "shift_test": each.shift.variant,
                "shapiro_w": each.normality[0].w,
                "shapiro_p": min(check.p for check in each.normality),
                **{f"t_{name}": getattr(each.t, name) for name in T_COLUMNS},
                **{f"power_{name}": value for name, value in msgspec.structs.asdict(each.power).items()},
            }


def _hypotheses(results: StudyResults) -> Iterator[dict[str, object]]:
    for each in results.hypotheses:
        low, high = each.bounds or (None, None)
        yield {
            **msgspec.structs.asdict(each.hypothesis),
            "low": low,
            "high": high,
            "family": "primary" if each.is_primary else "other",
            "test": each.test,
            "p": each.p,
            "p_holm": each.holm_p,
            "supported": each.is_supported,
            "why_untested": each.why_untested,
        }


def _names(family: str, each: Comparison) -> dict[str, object]:
    quantity = each.quantity
    return {
        "family": family,
        "measure": quantity.name,
        "unit": quantity.unit,
        "first": each.first,
        "second": each.second,
        "paired": each.is_paired,
    }


def _variants(results: StudyResults) -> Iterator[dict[str, object]]:
    for family in results.families:
        for each in family.comparisons:
            for test in each.variants:
                used = test.variant == each.test.variant
                yield {**_names(family.name, each), **msgspec.structs.asdict(test), "reported": used}


def _equivalence(results: StudyResults) -> Iterator[dict[str, object]]:
    for family in results.families:
        for each in family.comparisons:
            found = each.equivalence
            if found is not None:
                shown = {"equivalent": found.is_shown}
                yield {**_names(family.name, each), **msgspec.structs.asdict(found), **shown}


def _hit_rates(results: StudyResults) -> Iterator[dict[str, object]]:
    for each in results.timeouts:
        yield {"first": each.first, "second": each.second, **msgspec.structs.asdict(each.hits)}


def _worst_ranks(results: StudyResults) -> Iterator[dict[str, object]]:
    for each in results.timeouts:
        effect = {f"effect_{name}": value for name, value in msgspec.structs.asdict(each.effect).items()}
        test = msgspec.structs.asdict(each.worst_rank)
        yield {"first": each.first, "second": each.second, **test, **effect}


def _omnibus(results: StudyResults) -> Iterator[dict[str, object]]:
    for family in results.families:
        for each in family.omnibus:
            test = {"test": each.variant, "statistic": each.statistic, "p": each.p}
            yield {"family": family.name, "measure": each.quantity.name, **test}


def _terms(results: StudyResults) -> Iterator[dict[str, object]]:
    for model in results.order:
        model_columns = {
            "measure": model.name,
            "formula": model.formula,
            "n": model.runs,
            "participants": model.participants,
        }
        spread = {
            "participant_sd": model.participant_sd,
            "residual_sd": model.residual_sd,
            "remark": model.remark,
            "left_out": "; ".join(model.dropped),
        }
        for term in model.terms:
            yield {**model_columns, **msgspec.structs.asdict(term), **spread}


def _graded(scores: pd.DataFrame) -> pd.DataFrame:
    graded = scores.assign(grade="", percentiles="", adjective="").astype({"grade": object})
    for row, score in scores["sus"].dropna().items():
        found = grade(score)
        values = [found.letter, found.percentiles, adjective(score)]
        graded.loc[row, ["grade", "percentiles", "adjective"]] = values
    return graded


def _scores(results: StudyResults) -> pd.DataFrame:
    """Return all scores: questionnaire, participant, condition, position, answered, measure, value."""
    fixed = ["participant", "condition", "position", "answered"]
    parts = [
        table.melt(fixed, var_name="measure").assign(questionnaire=name)
        for name, table in results.scores.items()
    ]
    if not parts:
        return pd.DataFrame()
    return pd.concat(parts, ignore_index=True)[["questionnaire", *fixed, "measure", "value"]]


def _score_summary(results: StudyResults) -> pd.DataFrame:
    """Return n, mean and standard deviation of every score by condition."""
    scores = _scores(results)
    if scores.empty:
        return scores
    found = scores[scores["condition"].isin(results.conditions)].dropna(subset="value")
    described = found.groupby(["questionnaire", "measure", "condition"], sort=False)["value"]
    return described.agg(n="size", mean="mean", sd="std").reset_index()


def sus_summary(results: StudyResults) -> pd.DataFrame:
    """Return mean and grade of the SUS by condition."""
    rows, sheets = [], results.scores.get("sus", pd.DataFrame(columns=["condition", "sus"]))
    for condition in results.conditions:
        scores = sheets.loc[sheets["condition"] == condition, "sus"].dropna()
        if len(scores):
            mean, found = float(scores.mean()), grade(float(scores.mean()))
            sd = float(scores.std(ddof=1)) if len(scores) > 1 else float("nan")
            rows.append((condition, len(scores), mean, sd, found.letter, found.percentiles, adjective(mean)))
    columns = ["condition", "n", "mean", "sd", "grade", "percentiles", "adjective"]
    return pd.DataFrame(rows, columns=columns)


def _long(results: StudyResults) -> pd.DataFrame:
    """Return the tested values: participant, condition, measure, value."""
    parts = [
        table.rename_axis(columns="condition")
        .reset_index(names="participant")
        .melt("participant")
        .assign(measure=name)
        for name, table in results.values.items()
    ]
    return pd.concat(parts, ignore_index=True)[["participant", "condition", "measure", "value"]]
