"""Claims about the rules: every graph has a state, every rule has a graph, everything named is used."""

from collections.abc import Iterator

from haptigraph.graph import Names, Triplet
from haptigraph.messages import UNKNOWN
from haptigraph.proof.report import Claim, Violation
from haptigraph.proof.rules import Cube, cube
from haptigraph.proof.subject import Subject

__all__ = ["rules_claims"]


def rules_claims(subject: Subject) -> list[Claim]:
    """Return the claims about the rules of a procedure."""
    return [
        Claim("total", "every possible graph has a state", tuple(_without_state(subject))),
        Claim(
            "deterministic",
            "a graph by itself has one state, by construction: the first rule that fits",
        ),
        Claim(
            "reachable", "every rule is the first that fits some possible graph", tuple(_never_first(subject))
        ),
        Claim("possible", "every relation holds in some possible graph", tuple(_never_holding(subject))),
        Claim("used", "every relation, entity and pattern is used", tuple(_unused(subject))),
    ]


def _without_state(subject: Subject) -> Iterator[Violation]:
    world = subject.prover.smallest(Cube(), len(subject.rules))
    if world is not None:
        missing = [name for name in subject.space.unnamed if not world.mask & subject.space.entity_bits[name]]
        hint = ""
        if missing and any(
            place is None and set(scale.needs) & set(missing)
            for scale, place in zip(subject.space.scales, world.places, strict=True)
        ):
            hint = (
                f"; measures need {', '.join(missing)}, of which no [[entity]] says that it is always there"
            )
        sentence = f"no rule fits this graph, so it is {UNKNOWN!r} and silent by default{hint}"
        yield subject.violation(sentence, "states", world)


def _never_first(subject: Subject) -> Iterator[Violation]:
    for number, (state, rule) in enumerate(zip(subject.procedure.states, subject.rules, strict=True)):
        if subject.prover.exists(Cube(), number):
            continue
        about = f"state {state.name}"
        world = subject.prover.smallest(rule)
        if world is None:
            sentence = f"rule {number}, {state.name!r}, never fits: {subject.conflict(rule)} cannot be"
            yield subject.impossible(sentence, about, state.when)
        else:
            sentence = (
                f"rule {number}, {state.name!r}, is shadowed: wherever it fits, a rule before it does; "
                "here {state}"
            )
            yield subject.violation(sentence, about, world)


def _never_holding(subject: Subject) -> Iterator[Violation]:
    for relation in subject.procedure.schema.relations:
        wanted = cube(subject.space, when=[relation.names])
        if not subject.prover.exists(wanted):
            name = Triplet(*relation.names)
            given = cube(subject.space, when=[relation.names, *relation.given])
            sentence = f"{name} never holds: {subject.conflict(given)} cannot be"
            yield subject.impossible(sentence, f"relation {name}", [relation.names, *relation.given])


def _unused(subject: Subject) -> Iterator[Violation]:
    procedure, schema = subject.procedure, subject.procedure.schema
    asked = {names for state in procedure.states for names in (*state.when, *state.unless)}
    for relation in reversed(schema.relations):  # a relation may be given for earlier ones only
        if relation.names in asked:
            asked |= {*relation.given}
    asked |= _followed(subject, asked)
    for relation in schema.relations:
        name, used = Triplet(*relation.names), relation.names in asked
        if used != relation.recorded_only:
            continue
        world = subject.prover.smallest(cube(subject.space, when=[relation.names]))
        if world is not None:
            told = (
                "says recorded_only, but rules ask for it"
                if used
                else "is asked for by no rule, so it changes nothing; use it, remove it, or say recorded_only"
            )
            yield subject.violation(f"{name} {told}", f"relation {name}", world)
    yield from _unused_entities(subject)
    for pattern in procedure.patterns:
        if pattern.name not in {state.feel for state in procedure.states}:
            yield Violation(f"no state feels {pattern.name!r}", f"pattern {pattern.name}")


def _followed(subject: Subject, asked: set[Names]) -> set[Names]:
    """Return relations that no rule asks for, but whose measure a pattern follows."""
    procedure, schema = subject.procedure, subject.procedure.schema
    carried = {schema.measure_name(relation) for relation in schema.relations if relation.names in asked}
    wanted = {follow.measure for pattern in procedure.patterns for follow in pattern.follow} - carried
    return {
        relation.names
        for relation in schema.relations
        if schema.measure_name(relation) in wanted and not relation.recorded_only
    }


def _unused_entities(subject: Subject) -> Iterator[Violation]:
    procedure = subject.procedure
    mentioned = {name for state in procedure.states for name in state.absent}
    mentioned |= {name for scale in subject.space.scales for name in scale.needs}
    mentioned |= {entity.seen_with for entity in procedure.schema.entities}
    for entity in procedure.schema.entities:
        if entity.name not in mentioned:
            sentence = f"nothing asks for {entity.name}: no relation, no rule, no measure"
            world = subject.prover.smallest(cube(subject.space, present=[entity.name]))
            about = f"entity {entity.name}"
            yield subject.violation(sentence, about, world) if world else Violation(sentence, about)
