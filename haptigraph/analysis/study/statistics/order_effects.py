"""Effects of order and practice, estimated by a linear mixed model (statsmodels)."""

import warnings

import numpy as np
import pandas as pd
import statsmodels.formula.api as smf
from msgspec import Struct
from statsmodels.tools.sm_exceptions import ConvergenceWarning

from haptigraph.analysis.study.quantities import Quantity

__all__ = ["MixedModel", "Term", "fit_mixed", "order_effects"]


class Term(Struct, frozen=True):
    """One fixed effect with its Wald test and 95 % interval (normal: too narrow with few participants)."""

    name: str
    estimate: float
    error: float
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
    limits = fitted.conf_int()
    terms = [
        Term(
            term,
            float(fitted.fe_params[term]),
            float(fitted.bse_fe[term]),
            float(limits.loc[term, 0]),
            float(limits.loc[term, 1]),
            float(fitted.pvalues[term]),
        )
        for term in fitted.fe_params.index
    ]
    between, within = float(np.sqrt(fitted.cov_re.iloc[0, 0])), float(np.sqrt(fitted.scale))
    people = int(frame["participant"].nunique())
    return MixedModel(name, formula, len(frame), people, terms, between, within, remark)


def order_effects(runs: pd.DataFrame, quantity: Quantity, conditions: list[str]) -> MixedModel | None:
    """Model a measure by condition, position of the condition, and trial within it.

    Position is that in the participant's order (learning over the session); trial, if there are several, is
    practice within a block. None where the data do not separate these effects.

    Args:
        runs: One row per run, or per participant and condition.
        quantity: The modelled outcome; a column.
        conditions: The first is the reference.
    """
    frame = runs.dropna(subset=[quantity.name, "position"]).rename(columns={quantity.name: "value"})
    frame = frame[frame["condition"].isin(conditions)]
    practice = [name for name in ("position", "trial") if name in frame and frame[name].nunique() > 1]
    one_each = frame["participant"].nunique() == len(frame)
    if "position" not in practice or one_each or frame["value"].nunique() < 2:
        return None
    design = pd.get_dummies(frame["condition"], drop_first=True).assign(one=1).join(frame[practice])
    if design.shape[1] < len(conditions) + len(practice):
        return None
    if len(frame) < design.shape[1] + 3 or np.linalg.matrix_rank(design.to_numpy(float)) < design.shape[1]:
        return None
    compared = f"C(condition, levels={conditions!r})"
    try:
        return fit_mixed(frame, " + ".join((f"value ~ {compared}", *practice)), quantity.name)
    except np.linalg.LinAlgError:
        return None
