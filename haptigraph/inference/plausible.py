"""Thresholds that no eye allows: a checked schema -> refusals, each with the slip of units that explains it.

A threshold must separate something in every eye that can be registered, and be large enough to be measured. A
`reason` in the relation declares that an unusual one is meant.
"""

import math
import warnings
from collections.abc import Iterator, Mapping
from typing import NamedTuple, Protocol

from haptigraph.errors import Implausible
from haptigraph.graph import Relation, Schema, Triplet
from haptigraph.inference.units import BOUNDS, unit_of
from haptigraph.messages import Pattern
from haptigraph.toml_document import Document

__all__ = ["NEAR", "NEAR_MM", "Measured", "Plausible", "check_plausible"]

SLIPS = {
    "mm": (("um", 1e-3), ("m", 1e3), ("cm", 10.0)),
    "um": (("mm", 1e3), ("nm", 1e-3)),
    "deg": (("rad", 180 / math.pi),),
    "s": (("ms", 1e-3),),
}
"""By unit: others that a number may have been meant in, and their size in this one."""
MAX_RELEASE = 0.1  # of the range of plausible thresholds
NEAR_MM = 3.75
"""A quarter of the smallest eye that can be registered: what is further away is not near."""
NEAR = {**dict.fromkeys(("distance_mm", "radial_mm", "clearance_mm"), NEAR_MM), "gap_um": 1000 * NEAR_MM}
"""The same by measure of a distance, in its unit."""
NEAR_PREDICATES = ("touching", "near", "at", "approaching")
WALL_ENDS = {"inside": "lower", "outside": "upper"}


class Plausible(Protocol):
    """The thresholds of a measure that make sense; 0 always does."""

    @property
    def low(self) -> float:
        """A threshold is above it, in the unit of the measure."""

    @property
    def high(self) -> float:
        """A threshold is below it, in the unit of the measure."""

    @property
    def resolution(self) -> float:
        """In its unit; a smaller threshold cannot be measured."""

    @property
    def because(self) -> str:
        """Why, as a clause."""


class Measured(Protocol):
    """What this module needs to know of a measure."""

    @property
    def plausible(self) -> Plausible:
        """Its plausible thresholds."""


class _Finding(NamedTuple):
    path: str
    problem: str


def check_plausible(
    document: Document,
    schema: Schema,
    patterns: tuple[Pattern, ...],
    measures: Mapping[str, Measured],
    *,
    is_strict: bool,
) -> None:
    """Refuse the first implausible threshold, or warn of all if the text is that of an old recording.

    Args:
        document: The file of the procedure.
        schema: Its relations.
        patterns: Its patterns, which may follow measures.
        measures: What can be measured.
        is_strict: Whether somebody edits the text, so that refusing it helps.

    Raises:
        BadInput: With file, line and reason.
    """
    findings = [*_entities(schema), *_relations(schema, measures), *_follows(schema, patterns, measures)]
    if findings and is_strict:
        path, problem = findings[0]
        raise document.error(problem, path)
    if findings:
        more = f"; {len(findings) - 1} more like it" if len(findings) > 1 else ""
        warnings.warn(f"{document.file}: {findings[0].problem}{more}", Implausible, stacklevel=2)


def _entities(schema: Schema) -> Iterator[_Finding]:
    """Yield instruments that are said to be always there, which hides the graphs without them from proofs."""
    for number, entity in enumerate(schema.entities):
        is_tied = entity.visible_with and schema.entity(entity.visible_with).fixed
        if entity.group == "instrument" and (entity.fixed or is_tied):
            key = "fixed" if entity.fixed else "visible_with"
            problem = f"{entity.name} is an instrument, which may be lost from sight; remove {key}"
            yield _Finding(f"entity[{number}].{key}", problem)


def _relations(schema: Schema, measures: Mapping[str, Measured]) -> Iterator[_Finding]:
    for number, relation in enumerate(schema.relations):
        path = f"relation[{number}]"
        if relation.reason is not None:
            if not relation.reason.strip():
                yield _Finding(f"{path}.reason", "reason is empty; say why the threshold is meant")
            continue
        found = [
            _Finding(f"{path}.{key}", f"{Triplet(*relation.names)}: {key} = {value:g} {problem}")
            for key in BOUNDS
            if (value := getattr(relation, key)) is not None
            and (problem := _problem(relation, value, measures))
        ]
        more = _turned(relation) or _loose(relation, measures[relation.measure].plausible)
        if more and not found:
            found.append(_Finding(path, f"{Triplet(*relation.names)}: {more}"))
        yield from found


def _turned(relation: Relation) -> str:
    """Return what is wrong with bounds that contradict the relation's name; "" if nothing is."""
    lower = next((bound for bound in (relation.at_least, relation.above) if bound is not None), None)
    upper = next((bound for bound in (relation.at_most, relation.below) if bound is not None), None)
    is_distance = relation.measure in NEAR
    end = WALL_ENDS.get(relation.predicate) if relation.measure == "wall_mm" else None
    if is_distance and relation.predicate in NEAR_PREDICATES:
        end = "upper"
    if (end == "upper" and upper is None) or (end == "lower" and lower is None):
        article = "an" if end == "upper" else "a"
        needs = f"{relation.predicate} needs {article} {end} bound of {relation.measure}"
        return f"{needs}; correct it, or give a reason"
    if is_distance and relation.predicate == "touching":
        most = NEAR[relation.measure]
        if upper is not None and not 0 <= upper <= most:
            unit = unit_of(relation.measure)
            return f"touching is from 0 to at most {most:g} {unit}; correct it, or give a reason"
    return ""


def _loose(relation: Relation, plausible: Plausible) -> str:
    """Return what is wrong with a release that is far from its bound; "" if nothing is."""
    bounds = [getattr(relation, key) for key in BOUNDS if key != "release"]
    if relation.release is None:
        return ""
    distance = min(abs(relation.release - bound) for bound in bounds if bound is not None)
    most, unit = MAX_RELEASE * (plausible.high - plausible.low), unit_of(relation.measure)
    if distance <= most:
        return ""
    return (
        f"release = {relation.release:g} {unit} is {distance:g} {unit} from its bound, and the relation "
        f"hardly ever ends; at most {most:g} {unit} are plausible; correct it, or give a reason"
    )


def _follows(
    schema: Schema, patterns: tuple[Pattern, ...], measures: Mapping[str, Measured]
) -> Iterator[_Finding]:
    relations = {schema.measure_name(relation): relation for relation in schema.relations}
    meant = {schema.measure_name(relation) for relation in schema.relations if relation.reason is not None}
    for number, pattern in enumerate(patterns):
        for at, follow in enumerate(pattern.follow):
            for end, (value, _) in (("start", follow.start), ("end", follow.end)):
                problem = _problem(relations[follow.measure], value, measures)
                if problem and follow.measure not in meant:
                    path = f"pattern[{number}].follow[{at}].{end}"
                    yield _Finding(path, f"{pattern.name} follows {follow.measure}: {value:g} {problem}")


def _problem(relation: Relation, value: float, measures: Mapping[str, Measured]) -> str | None:
    """Return what is wrong with a threshold, as the rest of a sentence; None if nothing is."""
    plausible, unit = measures[relation.measure].plausible, unit_of(relation.measure)
    if not value or (plausible.low < value < plausible.high and abs(value) >= plausible.resolution):
        return None
    if plausible.low < value < plausible.high:
        known = f"{relation.measure} is known to {plausible.resolution:g} {unit}"
        problem = f"{unit} is too small to be measured: {known}"
    else:
        problem = (
            f"{unit} separates nothing: {relation.measure} of a threshold is between {plausible.low:g} and "
            f"{plausible.high:g} {unit}, because {plausible.because}"
        )
    meant = [
        f"{value:g} {other}, which is {value * size:.4g} {unit}"
        for other, size in SLIPS.get(unit, ())
        if plausible.low < value * size < plausible.high and abs(value * size) >= 10 * plausible.resolution
    ]
    hint = f"; did you mean {' or '.join(meant)}? Correct" if meant else "; correct"
    return f"{problem}{hint} it, or give a reason"
