"""Compare the quality of a trial's data with the thresholds of the protocol.

A trial beyond a threshold is flagged and counted; whether it is analysed is for the analysis to say.
"""

import math
from collections.abc import Mapping
from typing import Annotated, Any, NamedTuple

from msgspec import Meta, Struct

__all__ = ["Quality", "is_unrecorded", "quality_limits", "quality_problems"]

Fraction = Annotated[float, Meta(ge=0, le=1)]


class Quality(Struct, frozen=True, forbid_unknown_fields=True):
    """The [quality] table: beyond what a trial is flagged; 0 switches a threshold off."""

    min_images_per_s: Annotated[float, Meta(ge=0, le=1000)] = 0.0
    max_late_fraction: Fraction = 0.0
    """Of the images."""
    max_unseen_fraction: Fraction = 0.0
    """Of the time, without a needle or a visible tip."""
    max_gap_s: Annotated[float, Meta(ge=0, le=36_000)] = 0.0
    """Longest time in a row without a visible tip."""


class _Rule(NamedTuple):
    key: str
    measure: str
    bound: str
    scale: float
    unit: str


RULES = (
    _Rule("min_images_per_s", "images_per_s", "at least", 1, "images/s"),
    _Rule("max_late_fraction", "late_images_fraction", "at most", 100, "% late images"),
    _Rule("max_unseen_fraction", "unseen_fraction", "at most", 100, "% of the time without a visible tip"),
    _Rule("max_gap_s", "longest_gap_s", "at most", 1, "s in a row without a visible tip"),
)


def quality_limits(thresholds: Quality) -> list[str]:
    """Return the thresholds that are on, in words: "at least 20 images/s"."""
    return [f"{rule.bound} {rule.scale * limit:.4g} {rule.unit}" for rule, limit in _active_rules(thresholds)]


def quality_problems(row: Mapping[str, Any], thresholds: Quality) -> list[str]:
    """Return what is beyond a threshold, in words: "9.1 images/s (at least 20)".

    Args:
        row: A row of the table of trials, or the measures of a trial; what is missing, None or NaN is beyond
            no threshold (`is_unrecorded`).
        thresholds: The thresholds.
    """
    problems = []
    for rule, limit in _active_rules(thresholds):
        value = _value(row, rule.measure)
        is_beyond = value < limit if rule.bound == "at least" else value > limit  # never with NaN
        if is_beyond:
            allowed = f"{rule.bound} {rule.scale * limit:.4g}"
            problems.append(f"{rule.scale * value:.4g} {rule.unit} ({allowed})")
    return problems


def is_unrecorded(row: Mapping[str, Any], thresholds: Quality) -> bool:
    """Return whether a measure that has a threshold is missing, so that the trial cannot be judged."""
    return any(math.isnan(_value(row, rule.measure)) for rule, _ in _active_rules(thresholds))


def _active_rules(thresholds: Quality) -> list[tuple[_Rule, float]]:
    limits = [(rule, getattr(thresholds, rule.key)) for rule in RULES]
    return [(rule, limit) for rule, limit in limits if limit]


def _value(row: Mapping[str, Any], measure: str) -> float:
    value = row.get(measure)
    return math.nan if value is None else float(value)
