"""Claims that the author of a procedure makes in its file: invariants, gaps, overlaps, and temporal claims.

This module reads the claims and checks their names. `haptigraph.proof` proves them, except for the temporal
ones, which every run monitors. The rule engine does not use them.
"""

from collections.abc import Iterable
from typing import Annotated

from msgspec import Meta, Struct

from haptigraph.graph import Names, Schema
from haptigraph.inference.checks import check_name, check_relations
from haptigraph.toml_document import Document

__all__ = ["Gap", "Invariant", "Overlap", "Temporal", "check_claims", "check_temporal"]


CONCLUSIONS = ("feels", "never_feels", "states", "never_states", "forces", "never_forces")


class Invariant(Struct, frozen=True, forbid_unknown_fields=True):
    """A statement that must be true of every graph: whenever its premise matches, its conclusion holds."""

    name: str
    """The statement in words."""
    when: tuple[Names, ...] = ()
    """Premise: edges that are present."""
    unless: tuple[Names, ...] = ()
    """Premise: edges that are absent."""
    present: tuple[str, ...] = ()
    """Premise: entities that are present."""
    absent: tuple[str, ...] = ()
    """Premise: entities that are absent."""
    feels: tuple[str, ...] = ()
    """Conclusion: the pattern is one of these."""
    never_feels: tuple[str, ...] = ()
    """Conclusion: the pattern is none of these."""
    states: tuple[str, ...] = ()
    """Conclusion: the state is one of these."""
    never_states: tuple[str, ...] = ()
    """Conclusion: the state is none of these."""
    forces: tuple[str, ...] = ()
    """Conclusion: all of these force fields act."""
    never_forces: tuple[str, ...] = ()
    """Conclusion: none of these force fields acts."""

    def allows(self, state: str, feel: str, forces: tuple[str, ...]) -> bool:
        """Return whether the conclusion allows a state, a pattern, and force fields."""
        return (
            {*self.forces} <= {*forces}
            and not {*self.never_forces} & {*forces}
            and (not self.feels or feel in self.feels)
            and feel not in self.never_feels
            and (not self.states or state in self.states)
            and state not in self.never_states
        )


class Gap(Struct, frozen=True, forbid_unknown_fields=True):
    """Values of a measure that intentionally no relation covers."""

    measure: str
    """As graphs carry it: "distance_to_retina_mm"."""
    because: str
    at_most: float | None = None
    below: float | None = None
    at_least: float | None = None
    above: float | None = None


class Overlap(Struct, frozen=True, forbid_unknown_fields=True):
    """Two relations of one measure that intentionally may hold at once."""

    relations: tuple[Names, Names]
    because: str


class Temporal(Struct, frozen=True, forbid_unknown_fields=True):
    """A statement about time, monitored in every run: a response time or a maximum rate of changes."""

    name: str
    """The statement in words."""
    when: tuple[Names, ...] = ()
    """Premise: edges that are present."""
    unless: tuple[Names, ...] = ()
    """Premise: edges that are absent."""
    present: tuple[str, ...] = ()
    """Premise: entities that are present."""
    absent: tuple[str, ...] = ()
    """Premise: entities that are absent."""
    feels: tuple[str, ...] = ()
    """One of these patterns is commanded ..."""
    within_ms: Annotated[float, Meta(gt=0, le=60_000)] | None = None
    """... within this time after the premise became true, if it remains true."""
    most_changes: Annotated[int, Meta(ge=1)] | None = None
    """The commanded pattern changes at most this often ..."""
    in_ms: Annotated[float, Meta(gt=0, le=60_000)] = 1000.0
    """... in any interval of this length."""


def check_claims(
    document: Document,
    schema: Schema,
    names: tuple[Iterable[str], Iterable[str], Iterable[str]],
    claims: tuple[tuple[Invariant, ...], tuple[Gap, ...], tuple[Overlap, ...]],
) -> None:
    """Check that claims refer to names of the procedure.

    Args:
        document: The file of the procedure.
        schema: Its entities and relations.
        names: Those of its states, patterns and force fields.
        claims: Its claims.

    Raises:
        BadInput: With file, line and reason.
    """
    invariants, gaps, overlaps = claims
    states, patterns, forces = names
    valid = _valid_names(schema, patterns, states, forces)
    for number, invariant in enumerate(invariants):
        path = f"invariant[{number}]"
        _check_names(document, invariant, path, schema, valid)
        if not any(getattr(invariant, key) for key in CONCLUSIONS):
            raise document.error(f"claims nothing; give one of {', '.join(CONCLUSIONS)}", path)
    for number, gap in enumerate(gaps):
        path = f"gap[{number}]"
        check_name(document, "measure", gap.measure, schema.measure_names, f"{path}.measure")
        if gap.at_most is not None and gap.below is not None:
            raise document.error("both at_most and below are given; one of them is enough", path)
        if gap.at_least is not None and gap.above is not None:
            raise document.error("both at_least and above are given; one of them is enough", path)
        if {gap.at_most, gap.below, gap.at_least, gap.above} == {None}:
            raise document.error("no bound; give at_most, below, at_least or above", path)
    for number, overlap in enumerate(overlaps):
        check_relations(document, schema, overlap.relations, f"overlap[{number}].relations")


def check_temporal(
    document: Document, schema: Schema, patterns: Iterable[str], claims: tuple[Temporal, ...]
) -> None:
    """Check that temporal claims refer to names of the procedure, and that each makes exactly one claim.

    Raises:
        BadInput: With file, line and reason.
    """
    valid = _valid_names(schema, patterns)
    for number, claim in enumerate(claims):
        path = f"temporal[{number}]"
        _check_names(document, claim, path, schema, valid)
        if (claim.within_ms is None) == (claim.most_changes is None):
            raise document.error("give either feels and within_ms, or most_changes and in_ms", path)
        has_premise = bool(claim.when or claim.unless or claim.present or claim.absent)
        if claim.most_changes is not None and (claim.feels or has_premise):
            problem = "most_changes applies to every graph; remove feels, when, unless, present and absent"
            raise document.error(problem, path)
        if claim.within_ms is not None and not (claim.feels and has_premise):
            problem = "within_ms needs feels and a premise; give when, unless, present or absent"
            raise document.error(problem, path)


def _valid_names(
    schema: Schema, patterns: Iterable[str], states: Iterable[str] = (), forces: Iterable[str] = ()
) -> dict[str, list[str]]:
    entities = [entity.name for entity in schema.entities]
    return {"pattern": list(patterns), "state": list(states), "entity": entities, "force": list(forces)}


def _check_names(
    document: Document, claim: Invariant | Temporal, path: str, schema: Schema, valid: dict[str, list[str]]
) -> None:
    check_relations(document, schema, claim.when, f"{path}.when")
    check_relations(document, schema, claim.unless, f"{path}.unless")
    for key, what in (
        ("present", "entity"),
        ("absent", "entity"),
        ("feels", "pattern"),
        ("never_feels", "pattern"),
        ("states", "state"),
        ("never_states", "state"),
        ("forces", "force"),
        ("never_forces", "force"),
    ):
        for name in getattr(claim, key, ()):
            check_name(document, what, name, valid[what], f"{path}.{key}")
