"""What the author of a procedure claims of it, as written in the file: invariants, gaps, overlaps, and time.

Here the claims are read and their names checked; whether they are true, `haptigraph.proof` finds out, and of
those about time each run. Running a procedure needs none of them.
"""

from collections.abc import Iterable
from typing import Annotated

from msgspec import Meta, Struct

from haptigraph.errors import unknown_name
from haptigraph.graph import Names, Schema, Triplet
from haptigraph.toml_document import Document

__all__ = ["Gap", "Invariant", "Overlap", "Temporal", "check_claims", "check_temporal"]


class Invariant(Struct, frozen=True, forbid_unknown_fields=True):
    """A sentence that must be true of every graph: whenever the first part fits, the second holds."""

    name: str
    """The sentence, for people."""
    when: tuple[Names, ...] = ()
    """Edges that are there."""
    unless: tuple[Names, ...] = ()
    """Edges that are not there."""
    present: tuple[str, ...] = ()
    """Entities that are there."""
    absent: tuple[str, ...] = ()
    """Entities that are not there."""
    feels: tuple[str, ...] = ()
    """Then one of these patterns is felt."""
    never_feels: tuple[str, ...] = ()
    """Then none of these is."""
    states: tuple[str, ...] = ()
    """Then the state is one of these."""
    never_states: tuple[str, ...] = ()
    """Then it is none of these."""

    def allows(self, state: str, feel: str) -> bool:
        """Tell whether a graph that the first part fits may have this state and feel so."""
        return (
            (not self.feels or feel in self.feels)
            and feel not in self.never_feels
            and (not self.states or state in self.states)
            and state not in self.never_states
        )


class Gap(Struct, frozen=True, forbid_unknown_fields=True):
    """Values of a measure that none of its relations covers, on purpose."""

    measure: str
    """As graphs carry it: "distance_to_retina_mm"."""
    because: str
    at_most: float | None = None
    below: float | None = None
    at_least: float | None = None
    above: float | None = None


class Overlap(Struct, frozen=True, forbid_unknown_fields=True):
    """Two relations of one measure that may hold at once, on purpose."""

    relations: tuple[Names, Names]
    because: str


class Temporal(Struct, frozen=True, forbid_unknown_fields=True):
    """A sentence about time, watched in every run: felt soon enough, or not changing too often."""

    name: str
    """The sentence, for people."""
    when: tuple[Names, ...] = ()
    """Edges that are there."""
    unless: tuple[Names, ...] = ()
    """Edges that are not there."""
    present: tuple[str, ...] = ()
    """Entities that are there."""
    absent: tuple[str, ...] = ()
    """Entities that are not there."""
    feels: tuple[str, ...] = ()
    """One of these patterns is felt ..."""
    within_ms: Annotated[float, Meta(gt=0, le=60_000)] | None = None
    """... so soon after the above came true, if it stays so."""
    most_changes: Annotated[int, Meta(ge=1)] | None = None
    """The pattern that is felt changes no more often than this ..."""
    in_ms: Annotated[float, Meta(gt=0, le=60_000)] = 1000.0
    """... in any time so long."""


def check_claims(
    document: Document,
    schema: Schema,
    states: Iterable[str],
    patterns: Iterable[str],
    claims: tuple[tuple[Invariant, ...], tuple[Gap, ...], tuple[Overlap, ...]],
) -> None:
    """Check that claims speak of what there is.

    Raises:
        BadInput: With file, line and reason.
    """
    invariants, gaps, overlaps = claims
    known = {
        "pattern": sorted(patterns),
        "state": sorted(states),
        "entity": [entity.name for entity in schema.entities],
    }
    for number, invariant in enumerate(invariants):
        _check_invariant(document, invariant, f"invariant[{number}]", schema, known)
    measures = {schema.measure_name(relation) for relation in schema.relations}
    for number, gap in enumerate(gaps):
        if gap.measure not in measures:
            raise document.error(unknown_name("measure", gap.measure, measures), f"gap[{number}].measure")
        if gap.at_most is not None and gap.below is not None:
            raise document.error("both at_most and below are given; one of them is enough", f"gap[{number}]")
        if gap.at_least is not None and gap.above is not None:
            raise document.error("both at_least and above are given; one of them is enough", f"gap[{number}]")
        if {gap.at_most, gap.below, gap.at_least, gap.above} == {None}:
            raise document.error("no bound; give at_most, below, at_least or above", f"gap[{number}]")
    for number, overlap in enumerate(overlaps):
        _check_relations(document, overlap.relations, schema, f"overlap[{number}].relations")


def check_temporal(
    document: Document, schema: Schema, patterns: Iterable[str], claims: tuple[Temporal, ...]
) -> None:
    """Check that claims about time speak of what there is, and each of one thing.

    Raises:
        BadInput: With file, line and reason.
    """
    known = {"pattern": sorted(patterns), "entity": [entity.name for entity in schema.entities]}
    for number, claim in enumerate(claims):
        path = f"temporal[{number}]"
        _check_names(document, claim, path, schema, known)
        if (claim.within_ms is None) == (claim.most_changes is None):
            raise document.error("give either feels and within_ms, or most_changes and in_ms", path)
        has_first_part = bool(claim.when or claim.unless or claim.present or claim.absent)
        if claim.most_changes is not None and (claim.feels or has_first_part):
            raise document.error("most_changes goes alone, for it holds whatever the graph", path)
        if claim.within_ms is not None and not (claim.feels and has_first_part):
            raise document.error(
                "within_ms needs feels, and something that comes true: when, unless, present or absent", path
            )


def _check_invariant(
    document: Document, invariant: Invariant, path: str, schema: Schema, known: dict[str, list[str]]
) -> None:
    _check_names(document, invariant, path, schema, known)
    if not (invariant.feels or invariant.never_feels or invariant.states or invariant.never_states):
        raise document.error("claims nothing; give feels, never_feels, states or never_states", path)


def _check_names(
    document: Document,
    claim: Invariant | Temporal,
    path: str,
    schema: Schema,
    known: dict[str, list[str]],
) -> None:
    _check_relations(document, claim.when, schema, f"{path}.when")
    _check_relations(document, claim.unless, schema, f"{path}.unless")
    for key, what in (
        ("present", "entity"),
        ("absent", "entity"),
        ("feels", "pattern"),
        ("never_feels", "pattern"),
        ("states", "state"),
        ("never_states", "state"),
    ):
        for name in getattr(claim, key, ()):
            if name not in known[what]:
                raise document.error(unknown_name(what, name, known[what]), f"{path}.{key}")


def _check_relations(document: Document, wanted: Iterable[Names], schema: Schema, path: str) -> None:
    relations = [relation.names for relation in schema.relations]
    for names in wanted:
        if names not in relations:
            valid = " ".join(str(Triplet(*relation)) for relation in relations)
            raise document.error(f"{Triplet(*names)} is no relation; there are: {valid}", path)
