"""Effects of order, practice and target, estimated by a linear mixed model (statsmodels)."""

import warnings
from collections.abc import Iterable

import numpy as np
import pandas as pd
import statsmodels.formula.api as smf
from msgspec import Struct
from msgspec.structs import replace
from scipy import stats
from statsmodels.tools.sm_exceptions import ConvergenceWarning

from haptigraph.analysis.study.quantities import Quantity
from haptigraph.analysis.study.statistics.exact import smallest_p
from haptigraph.analysis.study.statistics.satterthwaite import errors_and_df
from haptigraph.study.plan import inseparable

__all__ = ["MixedModel", "Term", "fit_mixed", "order_effects"]

SAME_ORDER = "all participants met the conditions in the same order, so the two effects cannot be separated"
LEVEL = 0.05
SPARE = 3  # observations in excess of the coefficients


class Term(Struct, frozen=True):
    """One fixed effect with its t test and 95 % interval; degrees of freedom by Satterthwaite's method."""

    name: str
    estimate: float
    error: float
    df: float
    t: float
    low: float
    high: float
    p: float


class MixedModel(Struct, frozen=True):
    """A linear model with a random intercept per participant, fitted by REML."""

    name: str
    formula: str
    runs: int
    participants: int
    terms: list[Term]
    participant_sd: float
    residual_sd: float
    remark: str
    """Problem of the fit, or ""."""
    dropped: tuple[str, ...] = ()
    """Factors that vary and are not in the formula, each with the reason."""


def fit_mixed(frame: pd.DataFrame, formula: str, name: str = "") -> MixedModel:
    """Fit a formula with a random intercept per `participant`.

    Args:
        frame: One row per observation, no NaN in what the formula names.
        formula: In patsy's language.
        name: Of the modelled quantity.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        model = smf.mixedlm(formula, frame, groups=frame["participant"])
        fitted = model.fit(
            reml=True, method="powell", xtol=1e-10, ftol=1e-14
        )  # lbfgs runs into a singular matrix
    problems = {str(each.message) for each in caught if issubclass(each.category, ConvergenceWarning)}
    remark = "" if fitted.converged else "did not converge"
    if any("boundary" in text or "singular" in text for text in problems):
        remark = remark or "the variance between participants is at or near zero"
    spread = float(np.sqrt(fitted.cov_re.iloc[0, 0])), float(np.sqrt(fitted.scale))
    groups = np.unique(frame["participant"], return_inverse=True)[1]
    errors, df = errors_and_df(model.exog, model.endog, groups, *spread)
    estimates = fitted.fe_params.to_numpy()
    half, t = stats.t.ppf(0.975, df) * errors, estimates / errors
    columns = (estimates, errors, df, t, estimates - half, estimates + half, 2 * stats.t.sf(np.abs(t), df))
    terms = [
        Term(name, *map(float, row)) for name, *row in zip(fitted.fe_params.index, *columns, strict=True)
    ]
    people = int(frame["participant"].nunique())
    return MixedModel(name, formula, len(frame), people, terms, *spread, remark)


def order_effects(runs: pd.DataFrame, quantity: Quantity, conditions: list[str]) -> MixedModel | str:
    """Model a measure by condition, order, practice and target.

    Fixed effects: condition; position of the condition in the participant's order (period: learning over the
    session); where the data separate them, target, trial (practice within a block), and what a condition
    leaves behind: of two conditions the sequence, of more the condition before.

    Args:
        runs: One row per run, or per participant and condition.
        quantity: The modelled outcome; a column.
        conditions: The first is the reference.

    Returns:
        The model, or why there is none.
    """
    frame = runs.dropna(subset=[quantity.name, "position"]).rename(columns={quantity.name: "value"})
    frame = frame[frame["condition"].isin(conditions)]
    if reason := _why_unmodelled(frame):
        return reason
    frame = _with_factors(frame, runs, conditions)
    chosen, dropped = ["condition"], []
    for factor in ("position", "target", "trial", "sequence", "after"):
        if factor not in frame or frame[factor].nunique() < 2:
            continue
        if problem := _problem(frame, chosen, factor):
            dropped.append(f"{factor}, as {problem}")
        else:
            chosen.append(factor)
    if "position" not in chosen:
        is_same = (frame.groupby("condition", observed=True)["position"].nunique() == 1).all()
        return SAME_ORDER if is_same else f"{len(frame)} values are too few"
    try:
        fitted = fit_mixed(frame, f"value ~ {' + '.join(chosen)}", quantity.name)
    except np.linalg.LinAlgError:
        return "the fit failed"
    return replace(fitted, dropped=tuple(dropped))


def _why_unmodelled(frame: pd.DataFrame) -> str:
    """Return why values have no model, whatever its factors; empty if they may have one."""
    people = frame.groupby("participant")["condition"]
    if frame.empty or (people.nunique() < 2).all():
        return "no participant has values and positions of two conditions"
    if frame["value"].nunique() < 2:
        return "all values are equal"
    if people.ngroups < 2:
        return "only one participant has values"
    if "target" in frame and (listed := inseparable(_pairs(frame))):
        return f"condition cannot be separated from target ({listed})"
    if smallest_p(people.ngroups, people.ngroups, paired=True) >= LEVEL:
        return f"{people.ngroups} participants are too few: no ranks of so few reach p < {LEVEL}"
    return ""


def _pairs(frame: pd.DataFrame) -> list[tuple[str, str]]:
    """Return condition and target of the runs with a target."""
    known = frame.dropna(subset=["target"])
    return list(zip(known["condition"].astype(str), known["target"].astype(str), strict=True))


def _with_factors(frame: pd.DataFrame, runs: pd.DataFrame, conditions: list[str]) -> pd.DataFrame:
    """Add the factors that follow from the order in which a participant met the conditions.

    Of two conditions `sequence` is the first one; with position and condition it stands for any difference
    in carry-over (Jones & Kenward 2014, Design and Analysis of Cross-Over Trials, 3rd ed., section 2.2). Of
    more, `after` is the condition before; neither the reference nor the beginning has a carry-over.
    """
    order = runs.dropna(subset=["position"]).drop_duplicates(["participant", "position"])
    met = {(row.participant, row.position): row.condition for row in order.itertuples()}
    frame = frame.assign(condition=_factor(frame["condition"], conditions))
    where = list(zip(frame["participant"], frame["position"], strict=True))
    if len(conditions) == 2:
        other = dict(zip(conditions, conditions[::-1], strict=True))
        first = [met.get((who, 1)) or other.get(met.get((who, 2), "")) for who, _ in where]
        is_shared = len(met) and frame["participant"].nunique() > len(set(first)) + 1
        return frame.assign(sequence=_factor(first, conditions)) if is_shared else frame
    before = [conditions[0] if at == 1 else met.get((who, at - 1)) for who, at in where]
    return frame.assign(after=_factor(before, conditions))


def _factor(values: Iterable[object], levels: list[str]) -> pd.Categorical:
    return pd.Categorical(values, levels).remove_unused_categories()


def _problem(frame: pd.DataFrame, chosen: list[str], factor: str) -> str:
    """Return why a factor cannot be added to those chosen, with observations to spare; empty if it can."""
    if frame[factor].isna().any():
        return "some runs have none"
    if any(frame[each].nunique() < 2 for each in chosen):
        return f"all runs have the same {chosen[0]}"
    design = smf.ols(f"value ~ {' + '.join([*chosen, factor])}", frame).exog
    if np.linalg.matrix_rank(design) < design.shape[1]:
        return f"it cannot be separated from {', '.join(chosen)}"
    few = len(frame) < design.shape[1] + SPARE
    return f"{len(frame)} values are too few" if few else ""
