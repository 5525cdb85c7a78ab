"""A procedure: schema, rules and haptic grammar of one operation, loaded from one TOML file and checked.

Every error gives file, line, what was found and what would be valid.
"""

import hashlib
import string
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated, Any, Protocol

from msgspec import Meta, Struct, field

from haptigraph.display import ShownAsSvg
from haptigraph.errors import BadInput
from haptigraph.grammar import ForceField, Pattern
from haptigraph.graph import Entity, Names, Relation, Schema, Triplet
from haptigraph.inference.checks import check_name, check_pattern, check_relations, check_unique
from haptigraph.inference.claims import Gap, Invariant, Overlap, Temporal, check_claims, check_temporal
from haptigraph.inference.forces import check_force, check_forces_of_state
from haptigraph.inference.meaning import Kind, assumed_kind
from haptigraph.inference.plausible import Plausible, check_plausible
from haptigraph.inference.span import RunSpan, check_span
from haptigraph.inference.timing import check_timing
from haptigraph.inference.units import to_numbers
from haptigraph.messages import UNKNOWN
from haptigraph.toml_document import WARN_OF_OLD_KEYS, Document

__all__ = ["MeasureKind", "Procedure", "State", "load_procedure", "parse_procedure"]

GEOMETRIES = ("point", "segment", "polyline", "surface", "circle", "phase")


class MeasureKind(Protocol):
    """What a procedure needs to know of a measure."""

    @property
    def shapes(self) -> Mapping[tuple[str, str], object]:
        """The (subject, object) geometries that it supports."""

    @property
    def plausible(self) -> Plausible:
        """Its plausible thresholds."""

    @property
    def sd(self) -> Callable[[Any], float | None] | None:
        """How its standard deviation follows from that of the needle; None if it does not."""


class State(Struct, frozen=True, forbid_unknown_fields=True):
    """One rule: the graphs that put the surgery in a state, and the haptic pattern of that state."""

    name: str
    feel: str
    because: str
    """One sentence; measures in braces are filled in ("{theta_deg:.1f}")."""
    when: tuple[Names, ...] = ()
    """Edges that must be present."""
    unless: tuple[Names, ...] = ()
    """Edges that must be absent."""
    absent: tuple[str, ...] = ()
    """Entities that must be absent."""
    force: tuple[str, ...] = ()
    """Force fields that act."""
    hold_ms: Annotated[float, Meta(ge=0, le=10_000)] = 0.0
    """How long the state persists after its rule last matched, unless a rule of higher priority matches."""
    may_delay: tuple[str, ...] = ()
    """Alarms that its hold may delay."""
    enter_after_ms: Annotated[float, Meta(ge=0, le=10_000)] = 0.0
    """How long its rule must fit without interruption; until then the later rules decide."""
    kind: Kind | None = None
    """What it means to the surgeon; None if the file does not say it."""
    color: Annotated[str, Meta(pattern="^#[0-9a-fA-F]{6}$")] | None = None
    """In pictures and on pages; None: that of its kind."""


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
    forces: tuple[ForceField, ...] = field(name="force", default=())
    invariants: tuple[Invariant, ...] = field(name="invariant", default=())
    gaps: tuple[Gap, ...] = field(name="gap", default=())
    overlaps: tuple[Overlap, ...] = field(name="overlap", default=())
    temporal: tuple[Temporal, ...] = ()
    run: RunSpan | None = None


class Procedure(Struct, ShownAsSvg, frozen=True):
    """A checked procedure. States are in order of priority; the first match wins."""

    name: str
    title: str
    source: str
    schema: Schema
    states: tuple[State, ...]
    patterns: tuple[Pattern, ...]
    text: str
    """The file as read; recordings keep it."""
    forces: tuple[ForceField, ...] = ()
    invariants: tuple[Invariant, ...] = ()
    gaps: tuple[Gap, ...] = ()
    overlaps: tuple[Overlap, ...] = ()
    temporal: tuple[Temporal, ...] = ()
    span: RunSpan = RunSpan()

    def __repr__(self) -> str:
        return f"<Procedure {self.name}: {len(self.states)} states, sha256 {self.sha256[:12]}>"

    @property
    def sha256(self) -> str:
        """Hash of the file's text."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    @property
    def kinds(self) -> Mapping[str, Kind]:
        """What each state means to the surgeon, by its name."""
        felt = {pattern.name: pattern for pattern in self.patterns}
        strongest = max(pattern.amplitude for pattern in self.patterns)
        return {
            state.name: state.kind
            or assumed_kind(state.name, felt[state.feel], strongest, has_absent=bool(state.absent))
            for state in self.states
        }


def load_procedure(path: str | Path, measures: Mapping[str, MeasureKind]) -> Procedure:
    """Read and check a procedure file.

    Raises:
        BadInput: With file, line and reason, if it cannot be read or is invalid.
    """
    return _procedure(Document.read(path), measures, is_strict=True)


def parse_procedure(text: str, file: str, measures: Mapping[str, MeasureKind]) -> Procedure:
    """Read and check a procedure from text, such as that in a recording; `file` names it in errors.

    Nobody edits the text in a recording or a frozen study, so a renamed key in it causes no warning, and an
    implausible threshold no more than one.
    """
    before = WARN_OF_OLD_KEYS.set(False)
    try:
        return _procedure(Document(text, file), measures, is_strict=False)
    finally:
        WARN_OF_OLD_KEYS.reset(before)


def _procedure(document: Document, measures: Mapping[str, MeasureKind], *, is_strict: bool) -> Procedure:
    to_numbers(document)
    data = document.convert(_File)
    for kind, names in (
        ("entity", [entity.name for entity in data.entities]),
        ("relation", [str(Triplet(*relation.names)) for relation in data.relations]),
        ("state", [state.name for state in data.states]),
        ("pattern", [pattern.name for pattern in data.patterns]),
    ):
        check_unique(document, kind, names)
    for kind, parts in (("force", data.forces), ("invariant", data.invariants), ("temporal", data.temporal)):
        if parts:
            check_unique(document, kind, [part.name for part in parts])
    schema = Schema(data.entities, data.relations)
    _check_entities(document, schema)
    _check_relations(document, schema, measures)
    for number, pattern in enumerate(data.patterns):
        check_pattern(document, pattern, f"pattern[{number}]", schema)
    for number, force in enumerate(data.forces):
        check_force(document, force, f"force[{number}]", schema)
    for number, state in enumerate(data.states):
        path = f"state[{number}]"
        _check_state(document, state, path, schema, data.patterns)
        check_forces_of_state(document, state.name, state.force, state.absent, data.forces, f"{path}.force")
    _check_unknown(document, data)
    states, patterns, forces = (
        [part.name for part in parts] for parts in (data.states, data.patterns, data.forces)
    )
    claims = data.invariants, data.gaps, data.overlaps
    check_claims(document, schema, (states, patterns, forces), claims)
    check_temporal(document, schema, patterns, data.temporal)
    check_plausible(document, schema, data.patterns, measures, is_strict=is_strict)
    if data.run is not None:
        check_span(document, schema, states, data.run)
    procedure = Procedure(
        name=data.procedure.name,
        title=data.procedure.title or data.procedure.name,
        source=data.procedure.source,
        schema=schema,
        states=data.states,
        patterns=data.patterns,
        text=document.text,
        forces=data.forces,
        invariants=data.invariants,
        gaps=data.gaps,
        overlaps=data.overlaps,
        temporal=data.temporal,
        span=data.run or RunSpan(),
    )
    check_timing(document, procedure.states, procedure.kinds)
    return procedure


def _check_entities(document: Document, schema: Schema) -> None:
    for number, entity in enumerate(schema.entities):
        check_name(document, "geometry", entity.geometry, GEOMETRIES, f"entity[{number}].geometry")
        path, earlier = f"entity[{number}].visible_with", [other.name for other in schema.entities[:number]]
        if entity.fixed and entity.visible_with:
            raise document.error("both fixed and visible_with are given; keep one of them", path)
        if entity.visible_with and entity.visible_with not in earlier:
            problem = f"visible_with {entity.visible_with!r} is no entity declared before this one"
            raise document.error(problem, path)
        if entity.only_with:
            path = f"entity[{number}].only_with"
            others = [other.name for other in schema.entities if other is not entity]
            check_name(document, "entity", entity.only_with, others, path)
            if entity.fixed or entity.visible_with:
                taken = "fixed" if entity.fixed else "visible_with"
                raise document.error(f"both {taken} and only_with are given; keep one of them", path)


def _check_relations(document: Document, schema: Schema, measures: Mapping[str, MeasureKind]) -> None:
    entities = [entity.name for entity in schema.entities]
    named: dict[str, Relation] = {}
    for number, relation in enumerate(schema.relations):
        path = f"relation[{number}]"
        check_name(document, "entity", relation.subject, entities, f"{path}.subject")
        check_name(document, "entity", relation.object, entities, f"{path}.object")
        check_name(document, "measure", relation.measure, measures, f"{path}.measure")
        shapes = (schema.entity(relation.subject).geometry, schema.entity(relation.object).geometry)
        supported = measures[relation.measure].shapes
        if shapes not in supported:
            valid = " or ".join(f"{subject} to {object_}" for subject, object_ in supported)
            raise document.error(
                f"{relation.measure} measures {valid}, but {relation.subject} to {relation.object} is "
                f"{shapes[0]} to {shapes[1]}",
                f"{path}.measure",
            )
        _check_bounds(document, relation, path)
        if relation.margin_sd and measures[relation.measure].sd is None:
            valid = ", ".join(name for name, measure in measures.items() if measure.sd is not None)
            raise document.error(
                f"{relation.measure} has no standard deviation; remove margin_sd, or use {valid}",
                f"{path}.margin_sd",
            )
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
        raise document.error(f"no value is above {lowers[0]:g} and below {uppers[0]:g}", path)
    release = relation.release
    if release is None:
        return
    too_tight = (uppers and release < uppers[0]) and (not lowers or release > lowers[0])
    too_tight = too_tight or (not uppers and release > lowers[0])
    if too_tight:
        raise document.error(
            f"release {release:g} is within the bounds; it must be beyond one of them", f"{path}.release"
        )


def _check_state(
    document: Document, state: State, path: str, schema: Schema, patterns: tuple[Pattern, ...]
) -> None:
    check_relations(document, schema, state.when, f"{path}.when")
    check_relations(document, schema, state.unless, f"{path}.unless")
    impossible = [names for names in state.when if names in state.unless or {*names[::2]} & {*state.absent}]
    if impossible:
        problem = f"can never hold: {Triplet(*impossible[0])} is both required and excluded"
        raise document.error(problem, f"{path}.when")
    for name in state.absent:
        check_name(document, "entity", name, (entity.name for entity in schema.entities), f"{path}.absent")
    check_name(document, "pattern", state.feel, (pattern.name for pattern in patterns), f"{path}.feel")
    try:
        for _, measure, spec, conversion in string.Formatter().parse(state.because):
            if conversion:
                raise ValueError(f"a measure is a number; remove !{conversion}")
            if measure is not None:
                check_name(document, "measure", measure, schema.measure_names, f"{path}.because")
                format(1.0, spec or "")
    except ValueError as error:
        raise document.error(f"because cannot be filled in ({error})", f"{path}.because") from None


def _check_unknown(document: Document, data: _File) -> None:
    silent = {pattern.name for pattern in data.patterns if pattern.kind == "off"}
    for number, state in enumerate(data.states):
        if state.name == UNKNOWN:
            if state.feel not in silent:
                raise document.error(
                    f"{UNKNOWN!r} must have a pattern of kind 'off', found {state.feel!r}",
                    f"state[{number}].feel",
                )
            return
    raise BadInput(
        f"no [[state]] named {UNKNOWN!r}; add the one that holds when no needle is detected", document.file
    )
