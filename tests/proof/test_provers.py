"""Looking at every graph and asking z3 give the same answers; where z3 is missing, one sentence says so."""

import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from making import BREAKERS, break_it, load, sound
from msgspec.structs import replace

from haptigraph.assemble import load_procedure, parse_procedure
from haptigraph.errors import MissingExtra
from haptigraph.graph import Relation, Schema
from haptigraph.proof.by_z3 import BySolver
from haptigraph.proof.exhaustive import MOST_WORLDS, Exhaustive
from haptigraph.proof.prove import prove
from haptigraph.proof.rules import Cube
from haptigraph.proof.space import Space

SCHEMA = load_procedure("subretinal_injection").schema
BITS = len(SCHEMA.relations) + len(SCHEMA.entities)


@st.composite
def cubes(draw) -> Cube:
    some = draw(st.sets(st.integers(0, BITS - 1), max_size=4))
    require = sum(1 << bit for bit in some if draw(st.booleans()))
    return Cube(require, sum(1 << bit for bit in some) & ~require)


@st.composite
def schemas(draw) -> Schema:
    """The paper's schema with other thresholds, releases and givens, and entities that come and go."""
    relations = []
    bound = st.integers(0, 6).map(lambda half: half / 2)
    for number, relation in enumerate(SCHEMA.relations):
        low, high = sorted(draw(st.lists(bound, min_size=2, max_size=2, unique=True)))
        bounds = draw(st.sampled_from([{"at_most": high}, {"above": low}, {"at_least": low, "below": high}]))
        release = high + 0.5 if "above" not in bounds and draw(st.booleans()) else None
        given = draw(st.sampled_from([(), tuple(other.names for other in relations[-1:])])) if number else ()
        names = {"subject": relation.subject, "predicate": relation.predicate, "object": relation.object}
        relations.append(Relation(**names, measure=relation.measure, **bounds, release=release, given=given))
    loose = draw(st.sampled_from(["needle_line", "retina_target", "trocar", ""]))
    entities = tuple(
        type(one)(one.name, one.group, one.geometry, one.label) if one.name == loose else one
        for one in SCHEMA.entities
    )
    return Schema(entities, tuple(relations))


@settings(max_examples=25)
@given(schemas(), st.lists(cubes(), min_size=1, max_size=4), st.lists(cubes(), min_size=3, max_size=3))
def test_both_provers_agree_on_any_question(schema, rules, questions):
    space = Space(schema)
    looking, solving = Exhaustive(space, rules), BySolver(space, rules)
    for wanted in (Cube(), *questions):
        for fires in (None, *range(len(rules) + 1)):
            seen, solved = looking.smallest(wanted, fires), solving.smallest(wanted, fires)
            assert (seen is None) == (solved is None)
            for world in (seen, solved):
                if world is not None:
                    assert wanted.fits(world.mask)
                    first = next((n for n, rule in enumerate(rules) if rule.fits(world.mask)), len(rules))
                    assert fires in (None, first)
            if seen is not None and solved is not None:
                assert (seen.mask & space.visible).bit_count() == (solved.mask & space.visible).bit_count()


@pytest.mark.parametrize("breaker", [None, *BREAKERS], ids=lambda one: one.__name__ if one else "sound")
def test_both_provers_find_the_same_claims_violated(breaker):
    procedure = break_it(breaker, 3).procedure if breaker else load(sound(3).data)
    looked, solved = prove(procedure, "exhaustive"), prove(procedure, "z3")
    for one, other in zip(looked.claims, solved.claims, strict=True):
        assert [violation.about for violation in one.violations] == [
            violation.about for violation in other.violations
        ]


def many(points: int) -> str:
    """A procedure whose graphs are too many to be looked at: so many instruments, three zones each."""
    parts = ['[procedure]\nname = "many"\n']
    names = [f"tool{number}" for number in range(points)]
    for name in ("target", *names):
        parts.append(f'[[entity]]\nname = "{name}"\ngroup = "any"\ngeometry = "point"\nfixed = true\n')
    for name in names:
        for zone, bounds in (("at", "at_most = 1"), ("near", "above = 1\nat_most = 3"), ("far", "above = 3")):
            parts.append(
                f'[[relation]]\nsubject = "target"\npredicate = "{zone}"\nobject = "{name}"\nmeasure = "distance_mm"\n{bounds}\n'
            )
    parts.append('[[state]]\nname = "unknown"\nabsent = ["target"]\nfeel = "off"\nbecause = ""\n')
    for name in names:
        parts.append(
            f'[[state]]\nname = "at_{name}"\nwhen = [["target", "at", "{name}"]]\nfeel = "on"\nbecause = ""\n'
            f'[[state]]\nname = "near_{name}"\nwhen = [["target", "near", "{name}"]]\nfeel = "on"\nbecause = ""\n'
        )
    far = ", ".join(f'["target", "far", "{name}"]' for name in names)
    parts.append(f'[[state]]\nname = "free"\nwhen = [{far}]\nfeel = "off"\nbecause = ""\n')
    parts.append(
        '[[pattern]]\nname = "off"\nkind = "off"\n[[pattern]]\nname = "on"\nkind = "continuous"\namplitude = 0.2\n'
    )
    parts.append(f'[[invariant]]\nname = "far is silent"\nwhen = [{far}]\nfeels = ["off"]\n')
    return "\n".join(parts)


def test_many_graphs_are_left_to_z3_and_a_hole_among_them_is_found():
    sound_one = parse_procedure(many(12), "many.toml")
    assert Space(sound_one.schema).count() > MOST_WORLDS
    proof = prove(sound_one)
    assert proof.method.startswith("z3 ")
    assert proof.violations == []
    holed = many(12).replace(
        'when = [["target", "near", "tool7"]]',
        'when = [["target", "near", "tool7"], ["target", "at", "tool3"]]',
    )
    (total, *_) = prove(parse_procedure(holed, "many.toml")).claims
    (violation,) = total.violations
    assert [str(edge) for edge in violation.graph.edges if edge.predicate == "near"] == [
        "<target, near, tool7>"
    ]


def test_without_z3_one_sentence_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "z3", None)
    with pytest.raises(MissingExtra, match=r"pip install 'haptigraph\[proof\]'"):
        prove(parse_procedure(many(12), "many.toml"))
    assert prove(load_procedure("subretinal_injection")).holds


def test_a_state_that_is_held_is_told_beside_the_invariants_it_breaks_and_changes_no_proof(procedure):
    states = tuple(
        replace(one, hold_ms=200.0 if one.name in ("retinal_contact", "outside_eye") else 0.0)
        for one in procedure.states
    )
    for prover in ("exhaustive", "z3"):
        proof = prove(replace(procedure, states=states), prover)
        assert proof.holds
        assert proof.held_ms == {"retinal_contact": 200.0, "outside_eye": 200.0}
        told = {claim.says: claim.not_while_held for claim in proof.claims if claim.name == "invariant"}
        assert told["the alarm is felt at the retina only"] == ("retinal_contact",)
        assert told["touching the retina away from the target always feels the alarm"] == ()
        assert told["nothing vibrates when no needle is seen"] == ()


def test_counterexamples_are_judged_by_themselves_whatever_was_held_before(procedure):
    states = tuple(replace(one, hold_ms=200.0) for one in procedure.states if one.name != "outside_eye")
    held, plain = (
        prove(replace(procedure, states=tuple(replace(one, hold_ms=hold) for one in states))).violations
        for hold in (200.0, 0.0)
    )
    assert held == plain != []


def test_a_relation_whose_measure_is_followed_is_used():
    text = load_procedure("subretinal_injection_continuous").text
    text = text.replace("recorded_only = true", "recorded_only = false").replace(
        'measure = "distance_to_retina_mm"\nstart', 'measure = "distance_to_target_mm"\nstart'
    )
    assert prove(parse_procedure(text, "p.toml")).violations == []
    unused = text.replace(
        'measure = "distance_to_target_mm"\nstart', 'measure = "distance_to_retina_mm"\nstart'
    )
    (violation,) = prove(parse_procedure(unused, "p.toml")).violations
    assert "<needle_tip, approaching, retina_target> is asked for by no rule" in violation.sentence
