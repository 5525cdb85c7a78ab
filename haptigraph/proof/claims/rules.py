"""Claims about the rules: every graph has a state, every rule can fire, everything declared is used."""

from collections.abc import Iterator
from math import inf

from haptigraph.graph import Names, Relation, Triplet
from haptigraph.inference.plausible import NEAR, NEAR_MM
from haptigraph.messages import UNKNOWN
from haptigraph.proof.report import Claim, Violation
from haptigraph.proof.rules import Cube, make_cube
from haptigraph.proof.subject import Subject, bounds_of

__all__ = ["rules_claims"]

NEAR_BOUNDS = {**NEAR, "aside_mm": NEAR_MM, "depth_percent": 100.0}
"""Upper bounds that are near, by measure."""


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
        Claim("aimed", "success needs nearness to something", tuple(_aimless(subject))),
        Claim("used", "every relation, entity and pattern is used", tuple(_unused(subject))),
    ]


def _without_state(subject: Subject) -> Iterator[Violation]:
    world = subject.prover.smallest_witness(Cube(), len(subject.rules))
    if world is not None:
        space = subject.space
        missing = [name for name in space.undeclared if not world.mask & space.entity_bits[name]]
        hint = ""
        if missing and any(
            cell_state is None and set(scale.requires) & set(missing)
            for scale, cell_state in zip(space.scales, world.cell_states, strict=True)
        ):
            hint = f"; measures need {', '.join(missing)}; declare each as an [[entity]] with fixed = true"
        sentence = f"no rule fits this graph, so it is {UNKNOWN!r} and silent by default{hint}"
        yield subject.violation(sentence, "states", world)


def _never_first(subject: Subject) -> Iterator[Violation]:
    for number, (state, rule) in enumerate(zip(subject.procedure.states, subject.rules, strict=True)):
        if subject.prover.is_satisfiable(Cube(), number):
            continue
        about = f"state {state.name}"
        world = subject.prover.smallest_witness(rule)
        if world is None:
            sentence = f"rule {number}, {state.name!r}, never fits: {subject.conflict(rule)} is impossible"
            yield subject.impossible(sentence, about, state.when)
        else:
            sentence = (
                f"rule {number}, {state.name!r}, is shadowed: wherever it fits, an earlier rule does; "
                "here {state}"
            )
            yield subject.violation(sentence, about, world)


def _never_holding(subject: Subject) -> Iterator[Violation]:
    for relation in subject.procedure.schema.relations:
        if not subject.prover.is_satisfiable(make_cube(subject.space, when=[relation.names])):
            name = Triplet(*relation.names)
            given = make_cube(subject.space, when=[relation.names, *relation.given])
            sentence = f"{name} never holds: {subject.conflict(given)} is impossible"
            yield subject.impossible(sentence, f"relation {name}", [relation.names, *relation.given])


def _aimless(subject: Subject) -> Iterator[Violation]:
    kinds = subject.procedure.kinds
    relations = {relation.names: relation for relation in subject.procedure.schema.relations}
    for number, state in enumerate(subject.procedure.states):
        needed = [relations[names] for names in state.when]
        if kinds[state.name] != "success" or any(one.reason or _is_near(one) for one in needed):
            continue
        world = subject.prover.smallest_witness(Cube(), number)
        if world is not None:
            sentence = (
                f"{state.name} is success far from anything: no relation that it needs has an upper bound on "
                f"a distance, of {NEAR_MM:g} mm at most"
            )
            yield subject.violation(sentence, f"state {state.name}", world)


def _is_near(relation: Relation) -> bool:
    return bounds_of(relation).high <= NEAR_BOUNDS.get(relation.measure, -inf)


def _unused(subject: Subject) -> Iterator[Violation]:
    procedure, schema = subject.procedure, subject.procedure.schema
    used = {names for state in procedure.states for names in (*state.when, *state.unless)}
    for relation in reversed(schema.relations):  # `given` refers to earlier relations only
        if relation.names in used:
            used |= {*relation.given}
    used |= _followed(subject, used)
    for relation in schema.relations:
        name, is_used = Triplet(*relation.names), relation.names in used
        if is_used != relation.recorded_only:
            continue
        world = subject.prover.smallest_witness(make_cube(subject.space, when=[relation.names]))
        if world is not None:
            problem = (
                "has recorded_only, but rules use it; remove recorded_only"
                if is_used
                else "is used by no rule, so it changes nothing; use it, remove it, or add recorded_only"
            )
            yield subject.violation(f"{name} {problem}", f"relation {name}", world)
    yield from _unused_entities(subject)
    for pattern in procedure.patterns:
        if pattern.name not in {state.feel for state in procedure.states}:
            yield Violation(f"no state feels {pattern.name!r}", f"pattern {pattern.name}")


def _followed(subject: Subject, used: set[Names]) -> set[Names]:
    """Return relations that no rule uses, but whose measure a pattern follows."""
    procedure, schema = subject.procedure, subject.procedure.schema
    carried = {schema.measure_name(relation) for relation in schema.relations if relation.names in used}
    needed = {follow.measure for pattern in procedure.patterns for follow in pattern.follow} - carried
    return {
        relation.names
        for relation in schema.relations
        if schema.measure_name(relation) in needed and not relation.recorded_only
    }


def _unused_entities(subject: Subject) -> Iterator[Violation]:
    procedure = subject.procedure
    used = {name for state in procedure.states for name in state.absent}
    used |= {name for scale in subject.space.scales for name in scale.requires}
    used |= {name for entity in procedure.schema.entities for name in (entity.visible_with, entity.only_with)}
    for entity in procedure.schema.entities:
        if entity.name not in used:
            sentence = f"no relation, rule or measure uses {entity.name}; use it or remove it"
            world = subject.prover.smallest_witness(make_cube(subject.space, present=[entity.name]))
            about = f"entity {entity.name}"
            yield subject.violation(sentence, about, world) if world else Violation(sentence, about)
