"""Group the comparisons of a study into families, and correct each by Holm's method."""

from collections.abc import Sequence

import pandas as pd
from msgspec import Struct

from haptigraph.analysis.study.preregistered.hypotheses import HypothesisResult, holm_corrected, is_about
from haptigraph.analysis.study.quantities import FAMILIES, Quantity
from haptigraph.analysis.study.statistics.comparison import Comparison, omnibus

__all__ = ["Family", "Omnibus", "Samples", "families_of"]


class Samples(Struct, frozen=True):
    """The values that are compared."""

    values: dict[str, pd.DataFrame]
    """By quantity: one value per participant (rows) and condition (columns)."""
    conditions: list[str]
    is_within: bool
    silent: dict[str, list[str]]
    """By quantity: the conditions in which it is 0 by construction."""

    def conditions_of(self, quantity: Quantity) -> list[str]:
        """Return the conditions between which a quantity is compared."""
        return [each for each in self.conditions if each not in self.silent[quantity.name]]


class Omnibus(Struct, frozen=True):
    """An omnibus test of three or more conditions."""

    quantity: Quantity
    variant: str
    statistic: float
    p: float


class Family(Struct, frozen=True):
    """Comparisons that are reported together."""

    name: str
    about: str
    comparisons: list[Comparison]
    holm: list[float]
    """p-values corrected by Holm's step-down method, one per comparison: a preregistered one as `hypotheses`
    says, the exploratory ones together."""
    omnibus: list[Omnibus]
    explored: int
    """Number of exploratory comparisons."""


def families_of(
    quantities: Sequence[Quantity],
    samples: Samples,
    compared: Sequence[Comparison],
    hypotheses: Sequence[HypothesisResult],
    alpha: float,
) -> list[Family]:
    """Return the families that have comparisons."""
    families = []
    for name, about in FAMILIES.items():
        here = [each for each in compared if each.quantity.family == name]
        confirmed = [
            next((known.holm_p for known in hypotheses if is_about(known.hypothesis, each)), None)
            for each in here
        ]
        others = [each.test.p for each, p in zip(here, confirmed, strict=True) if p is None]
        corrected = iter(holm_corrected(others, alpha))
        holm = [next(corrected) if p is None else p for p in confirmed]
        tested = [_omnibus(each, samples) for each in quantities if each.family == name]
        families.append(Family(name, about, here, holm, [each for each in tested if each], len(others)))
    return [family for family in families if family.comparisons]


def _omnibus(quantity: Quantity, samples: Samples) -> Omnibus | None:
    conditions = samples.conditions_of(quantity)
    table = samples.values[quantity.name][conditions]
    whole = table.dropna() if samples.is_within else table
    tested = [[float(value) for value in whole[each].dropna()] for each in conditions]
    if len(tested) < 3 or not all(tested):
        return None
    return Omnibus(quantity, *omnibus(tested, paired=samples.is_within))
