"""Score a questionnaire as its `[score]` table says: reverse items, weight them, sum or average, rescale."""

import math
from collections.abc import Mapping
from typing import Annotated, Literal, TypeAlias

from msgspec import Meta, Struct, field

from haptigraph.errors import unknown_name

__all__ = ["Bounds", "Scale", "Scoring", "Subscale", "scales_of", "score", "scoring_problem"]

Bounds: TypeAlias = Mapping[str, tuple[float, float]]
"""The lowest and highest answer by item, of the items that have both."""


class Subscale(Struct, frozen=True, forbid_unknown_fields=True):
    """One [[score.subscale]]: a score of its own over some items."""

    name: Annotated[str, Meta(pattern="^[A-Za-z0-9][A-Za-z0-9_.-]{0,59}$")]
    title: str
    items: tuple[str, ...]


class Scoring(Struct, frozen=True, forbid_unknown_fields=True):
    """The [score] table."""

    method: Literal["mean", "sum"]
    title: str = ""
    """Of the total; empty: the questionnaire's."""
    items: tuple[str, ...] = ()
    """Items of the total; empty: all scales and all numbers with both bounds."""
    reversed: tuple[str, ...] = ()
    """Items that count from their high end."""
    weights: dict[str, Annotated[float, Meta(gt=0)]] = {}
    """Weights other than 1, by item."""
    range: tuple[float, float] | None = None
    """The lowest and the highest score; empty: those of the answers."""
    subscales: tuple[Subscale, ...] = field(name="subscale", default=())


class Scale(Struct, frozen=True):
    """A score of a questionnaire: the total or a subscale."""

    name: str
    """Its column: the questionnaire's name, for a subscale followed by `_` and its own."""
    title: str
    items: tuple[str, ...]
    low: float
    """The lowest score."""
    high: float


def scoring_problem(scoring: Scoring, bounds: Bounds) -> tuple[str, str] | None:
    """Return the first problem of a [score] table, and its key; None without one."""
    used = {"items": scoring.items, "reversed": scoring.reversed, "weights": tuple(scoring.weights)}
    used |= {f"subscale[{number}].items": each.items for number, each in enumerate(scoring.subscales)}
    for key, items in used.items():
        for number, item in enumerate(items):
            if item not in bounds:
                return unknown_name("item with low and high", item, bounds), key
            if item in items[:number]:
                return f"item {item!r} occurs twice; remove one of them", key
        if not items and key.startswith("subscale"):
            return "a subscale without items; name one or more", key
    if not bounds:
        return "no item has low and high; only such items are scored", "method"
    names = [each.name for each in scoring.subscales]
    if len(set(names)) < len(names):
        return "two subscales of the same name; names must differ", "subscale"
    if scoring.range is not None and scoring.range[0] >= scoring.range[1]:
        return f"range: expected the lowest and the highest score, found {list(scoring.range)}", "range"
    return None


def scales_of(scoring: Scoring, name: str, title: str, bounds: Bounds) -> list[Scale]:
    """Return the total and the subscales of a questionnaire of that name and title."""
    parts = [(name, scoring.title or title, scoring.items or tuple(bounds))]
    parts += [(f"{name}_{each.name}", each.title, each.items) for each in scoring.subscales]
    ends = [
        scoring.range
        or tuple(_combined(scoring, {item: bounds[item][end] for item in items}) for end in (0, 1))
        for _, _, items in parts
    ]
    return [Scale(*part, low, high) for part, (low, high) in zip(parts, ends, strict=True)]


def score(scoring: Scoring, scale: Scale, answers: Mapping[str, float], bounds: Bounds) -> float:
    """Return a score.

    Args:
        scoring: The questionnaire's.
        scale: The total or a subscale.
        answers: By item.
        bounds: Of the questionnaire's items.

    Returns:
        From `scale.low` to `scale.high`; NaN if an answer is missing, as nothing is imputed.
    """
    if not set(scale.items) <= answers.keys():
        return math.nan
    turned = {
        item: sum(bounds[item]) - answers[item] if item in scoring.reversed else answers[item]
        for item in scale.items
    }
    if scoring.range is None:
        return _combined(scoring, turned)
    weights = {item: scoring.weights.get(item, 1.0) for item in scale.items}
    above = sum(weights[item] * (turned[item] - bounds[item][0]) for item in scale.items)
    widest = sum(weights[item] * (bounds[item][1] - bounds[item][0]) for item in scale.items)
    return scale.low + (scale.high - scale.low) * above / widest


def _combined(scoring: Scoring, values: Mapping[str, float]) -> float:
    weights = {item: scoring.weights.get(item, 1.0) for item in values}
    total = sum(weights[item] * value for item, value in values.items())
    return total / sum(weights.values()) if scoring.method == "mean" else total
