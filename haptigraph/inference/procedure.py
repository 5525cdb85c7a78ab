"""A procedure: schema, rules and haptic grammar of one operation, loaded from one TOML file and checked.

Knows no camera and no device. Every mistake is told with file, line, what was found and what would be valid.
"""

import hashlib
import string
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, TypeAlias

from msgspec import Meta, Struct, field

from haptigraph.errors import BadInput
from haptigraph.graph import Entity, Names, Relation, Schema, Triplet
from haptigraph.inference.claims import Gap, Invariant, Overlap, Temporal, check_claims, check_temporal
from haptigraph.inference.pattern_check import check_known, check_pattern
from haptigraph.inference.span import RunSpan, check_span
from haptigraph.messages import UNKNOWN, Pattern
from haptigraph.toml_document import Document

__all__ = ["MeasureShapes", "Procedure", "State", "load_procedure", "parse_procedure"]

MeasureShapes: TypeAlias = Mapping[str, tuple[tuple[str, str], ...]]
"""The measures there are, and the (subject, object) geometries each is made for."""

GEOMETRIES = ("point", "segment", "polyline", "circle", "phase")


class State(Struct, frozen=True, forbid_unknown_fields=True):
    """One rule: the graph that makes a surgical state, and what it feels like."""

    name: str
    feel: str
    because: str
    """One sentence; measures in braces are filled in ("{theta_deg:.1f}")."""
    when: tuple[Names, ...] = ()
    """Edges that must be there."""
    unless: tuple[Names, ...] = ()
    """Edges that must not be there."""
    absent: tuple[str, ...] = ()
    """Entities that must not be there."""
    hold_ms: Annotated[float, Meta(ge=0, le=10_000)] = 0.0
    """For so long after its rule last fitted the state stays, unless one of higher priority fits."""


class _Title(Struct, frozen=True, forbid_unknown_fields=True):
    name: str
    title: str = ""
    source: str = ""


class _File(Struct, frozen=True, forbid_unknown_fields=True):
    procedure: _Title
    entities: tuple[Entity, ...] = field(name="entity")
    relations: tuple[Relation, ...] = field(name="relation")
    states: tuple[State, ...] = field(name="state")
    patterns: tuple[Pattern, ...] = field(name="pattern")
    invariants: tuple[Invariant, ...] = field(name="invariant", default=())
    gaps: tuple[Gap, ...] = field(name="gap", default=())
    overlaps: tuple[Overlap, ...] = field(name="overlap", default=())
    temporal: tuple[Temporal, ...] = ()
    run: RunSpan | None = None


class Procedure(Struct, frozen=True):
    """A checked procedure. States stand in order of priority, first wins."""

    name: str
    title: str
    source: str
    schema: Schema
    states: tuple[State, ...]
    patterns: tuple[Pattern, ...]
    text: str
    """The file as read; recordings keep it."""
    invariants: tuple[Invariant, ...] = ()
    gaps: tuple[Gap, ...] = ()
    overlaps: tuple[Overlap, ...] = ()
    temporal: tuple[Temporal, ...] = ()
    span: RunSpan = RunSpan()

    @property
    def sha256(self) -> str:
        """Fingerprint of the file's text."""
        return hashlib.sha256(self.text.encode()).hexdigest()


def load_procedure(path: str | Path, measures: MeasureShapes) -> Procedure:
    """Read and check a procedure file.

    Raises:
        BadInput: With file, line and reason, if it cannot be read or is not sound.
    """
    return _procedure(Document.read(path), measures)


def parse_procedure(text: str, file: str, measures: MeasureShapes) -> Procedure:
    """Read and check a procedure from text, for example from a recording; `file` names it in errors."""
    return _procedure(Document(text, file), measures)


def _procedure(document: Document, measures: MeasureShapes) -> Procedure:
    data = document.convert(_File)
    for kind, names in (
        ("entity", [entity.name for entity in data.entities]),
        ("relation", [str(Triplet(*relation.names)) for relation in data.relations]),
        ("state", [state.name for state in data.states]),
        ("pattern", [pattern.name for pattern in data.patterns]),
    ):
        _check_unique(document, kind, names)
    if data.invariants:
        _check_unique(document, "invariant", [invariant.name for invariant in data.invariants])
    if data.temporal:
        _check_unique(document, "temporal", [claim.name for claim in data.temporal])
    schema = Schema(data.entities, data.relations)
    _check_entities(document, schema)
    _check_relations(document, schema, measures)
    for number, pattern in enumerate(data.patterns):
        check_pattern(document, pattern, f"pattern[{number}]", schema)
    for number, state in enumerate(data.states):
        _check_state(document, state, f"state[{number}]", schema, data.patterns)
    _check_unknown(document, data)
    states, patterns = ([part.name for part in parts] for parts in (data.states, data.patterns))
    check_claims(document, schema, states, patterns, (data.invariants, data.gaps, data.overlaps))
    check_temporal(document, schema, patterns, data.temporal)
    if data.run is not None:
        check_span(document, schema, states, data.run)
    return Procedure(
        name=data.procedure.name,
        title=data.procedure.title or data.procedure.name,
        source=data.procedure.source,
        schema=schema,
        states=data.states,
        patterns=data.patterns,
        text=document.text,
        invariants=data.invariants,
        gaps=data.gaps,
        overlaps=data.overlaps,
        temporal=data.temporal,
        span=data.run or RunSpan(),
    )


def _check_unique(document: Document, kind: str, names: list[str]) -> None:
    if not names:
        raise document.error(f"no [[{kind}]] at all; at least one is needed", "procedure")
    for number, name in enumerate(names):
        if not name.strip():
            raise document.error(f"a {kind} without a name", f"{kind}[{number}].name")
        if name in names[:number]:
            raise document.error(f"a second {kind} {name!r}; names must differ", f"{kind}[{number}].name")


def _check_entities(document: Document, schema: Schema) -> None:
    for number, entity in enumerate(schema.entities):
        check_known(document, "geometry", entity.geometry, GEOMETRIES, f"entity[{number}].geometry")
        if entity.fixed and entity.seen_with:
            raise document.error("both fixed and seen_with are given", f"entity[{number}].seen_with")
        if entity.seen_with and entity.seen_with not in [other.name for other in schema.entities[:number]]:
            problem = f"seen_with {entity.seen_with!r} is no entity declared before this one"
            raise document.error(problem, f"entity[{number}].seen_with")


def _check_relations(document: Document, schema: Schema, measures: MeasureShapes) -> None:
    entities = [entity.name for entity in schema.entities]
    named: dict[str, Relation] = {}
    for number, relation in enumerate(schema.relations):
        path = f"relation[{number}]"
        check_known(document, "entity", relation.subject, entities, f"{path}.subject")
        check_known(document, "entity", relation.object, entities, f"{path}.object")
        check_known(document, "measure", relation.measure, measures, f"{path}.measure")
        shapes = (schema.entity(relation.subject).geometry, schema.entity(relation.object).geometry)
        if shapes not in measures[relation.measure]:
            valid = " or ".join(f"{subject} to {object_}" for subject, object_ in measures[relation.measure])
            raise document.error(
                f"{relation.measure} measures {valid}, but {relation.subject} to {relation.object} is "
                f"{shapes[0]} to {shapes[1]}",
                f"{path}.measure",
            )
        _check_bounds(document, relation, path)
        earlier = [other.names for other in schema.relations[:number]]
        for given in relation.given:
            if given not in earlier:
                raise document.error(
                    f"given {Triplet(*given)} is no relation declared before this one", f"{path}.given"
                )
        name = schema.measure_name(relation)
        other = named.setdefault(name, relation)
        if (other.measure, other.subject, other.object) != (
            relation.measure,
            relation.subject,
            relation.object,
        ):
            raise document.error(
                f"{name} would mean both {other.subject} to {other.object} and "
                f"{relation.subject} to {relation.object}; give their entities different labels",
                f"{path}.measure",
            )


def _check_bounds(document: Document, relation: Relation, path: str) -> None:
    uppers = [bound for bound in (relation.at_most, relation.below) if bound is not None]
    lowers = [bound for bound in (relation.at_least, relation.above) if bound is not None]
    if not uppers and not lowers:
        raise document.error("no bound; give at_most, below, at_least or above", path)
    if len(uppers) > 1 or len(lowers) > 1:
        both = "at_most and below" if len(uppers) > 1 else "at_least and above"
        raise document.error(f"both {both} are given; one of them is enough", path)
    if uppers and lowers and lowers[0] >= uppers[0]:
        raise document.error(f"nothing lies above {lowers[0]:g} and below {uppers[0]:g}", path)
    release = relation.release
    if release is None:
        return
    too_tight = (uppers and release < uppers[0]) and (not lowers or release > lowers[0])
    too_tight = too_tight or (not uppers and release > lowers[0])
    if too_tight:
        raise document.error(
            f"release {release:g} lies within the bounds; it must lie beyond one of them", f"{path}.release"
        )


def _check_state(
    document: Document, state: State, path: str, schema: Schema, patterns: tuple[Pattern, ...]
) -> None:
    relations = [relation.names for relation in schema.relations]
    for key, wanted in (("when", state.when), ("unless", state.unless)):
        for names in wanted:
            if names not in relations:
                valid = " ".join(str(Triplet(*relation)) for relation in relations)
                raise document.error(f"{Triplet(*names)} is no relation; there are: {valid}", f"{path}.{key}")
    impossible = [names for names in state.when if names in state.unless or {*names[::2]} & {*state.absent}]
    if impossible:
        problem = f"can never hold: {Triplet(*impossible[0])} is asked for and ruled out"
        raise document.error(problem, f"{path}.when")
    for name in state.absent:
        check_known(document, "entity", name, (entity.name for entity in schema.entities), f"{path}.absent")
    check_known(document, "pattern", state.feel, (pattern.name for pattern in patterns), f"{path}.feel")
    measures = {schema.measure_name(relation) for relation in schema.relations}
    try:
        for _, measure, spec, conversion in string.Formatter().parse(state.because):
            if conversion:
                raise ValueError(f"a measure is a number; !{conversion} is not for numbers")
            if measure is not None:
                check_known(document, "measure", measure, measures, f"{path}.because")
                format(1.0, spec or "")
    except ValueError as error:
        raise document.error(f"because cannot be filled in ({error})", f"{path}.because") from None


def _check_unknown(document: Document, data: _File) -> None:
    silent = {pattern.name for pattern in data.patterns if pattern.kind == "off"}
    for number, state in enumerate(data.states):
        if state.name == UNKNOWN:
            if state.feel not in silent:
                raise document.error(
                    f"{UNKNOWN!r} must feel a pattern of kind 'off', found {state.feel!r}",
                    f"state[{number}].feel",
                )
            return
    raise BadInput(
        f"no [[state]] named {UNKNOWN!r}; it says what holds when no needle is seen", document.file
    )
