"""Enumeration and z3 give the same results; without z3, the error is one sentence."""

import sys

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from making import MUTATIONS, load, mutate, sound
from msgspec.structs import replace

from haptigraph.assemble import load_procedure, parse_procedure
from haptigraph.errors import MissingExtra
from haptigraph.graph import Relation, Schema
from haptigraph.proof.exhaustive_prover import MAX_WORLDS, ExhaustiveProver
from haptigraph.proof.prove import prove
from haptigraph.proof.rules import Cube
from haptigraph.proof.space import Space
from haptigraph.proof.z3_prover import Z3Prover

SCHEMA = load_procedure("subretinal_injection").schema
BITS = len(SCHEMA.relations) + len(SCHEMA.entities)


@st.composite
def cubes(draw) -> Cube:
    some = draw(st.sets(st.integers(0, BITS - 1), max_size=4))
    require = sum(1 << bit for bit in some if draw(st.booleans()))
    return Cube(require, sum(1 << bit for bit in some) & ~require)


@st.composite
def schemas(draw) -> Schema:
    """The paper's schema with other thresholds, releases, margins and givens, and entities that appear and vanish."""
    relations = []
    bound = st.integers(0, 6).map(lambda half: half / 2)
    for number, relation in enumerate(SCHEMA.relations):
        low, high = sorted(draw(st.lists(bound, min_size=2, max_size=2, unique=True)))
        bounds = draw(st.sampled_from([{"at_most": high}, {"above": low}, {"at_least": low, "below": high}]))
        release = high + 0.5 if "above" not in bounds and draw(st.booleans()) else None
        given = draw(st.sampled_from([(), tuple(other.names for other in relations[-1:])])) if number else ()
        names = {"subject": relation.subject, "predicate": relation.predicate, "object": relation.object}
        margin = draw(st.sampled_from([0.0, 0.0, 1.0, 2.5]))
        relations.append(
            Relation(
                **names,
                measure=relation.measure,
                **bounds,
                release=release,
                margin_sd=margin,
                given=given,
            )
        )
    loose = draw(st.sampled_from(["needle_line", "retina_target", "trocar", ""]))
    entities = tuple(
        type(one)(one.name, one.group, one.geometry, one.label) if one.name == loose else one
        for one in SCHEMA.entities
    )
    return Schema(entities, tuple(relations))


@settings(max_examples=25)
@given(schemas(), st.lists(cubes(), min_size=1, max_size=4), st.lists(cubes(), min_size=3, max_size=3))
def test_both_provers_agree_on_any_query(schema, rules, queries):
    space = Space(schema)
    enumeration, solver = ExhaustiveProver(space, rules), Z3Prover(space, rules)
    for cube in (Cube(), *queries):
        for first_match in (None, *range(len(rules) + 1)):
            found, solved = (prover.smallest_witness(cube, first_match) for prover in (enumeration, solver))
            assert (found is None) == (solved is None)
            for world in (found, solved):
                if world is not None:
                    assert cube.matches(world.mask)
                    first = next((n for n, rule in enumerate(rules) if rule.matches(world.mask)), len(rules))
                    assert first_match in (None, first)
            if found is not None and solved is not None:
                assert (found.mask & space.visible).bit_count() == (solved.mask & space.visible).bit_count()


@pytest.mark.parametrize("mutation", [None, *MUTATIONS], ids=lambda one: one.__name__ if one else "sound")
def test_both_provers_find_the_same_violations(mutation):
    procedure = mutate(mutation, 3).procedure if mutation else load(sound(3).data)
    enumerated, solved = prove(procedure, "exhaustive"), prove(procedure, "z3")
    for one, other in zip(enumerated.claims, solved.claims, strict=True):
        assert [violation.about for violation in one.violations] == [
            violation.about for violation in other.violations
        ]


def many(points: int) -> str:
    """A procedure with too many graphs to enumerate: many instruments with three zones each."""
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


def test_z3_proves_a_space_that_is_too_large_to_enumerate_and_finds_a_hole_in_it():
    sound_one = parse_procedure(many(12), "many.toml")
    assert Space(sound_one.schema).count() > MAX_WORLDS
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


def test_the_error_without_z3_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "z3", None)
    with pytest.raises(MissingExtra, match=r"pip install 'haptigraph\[proof\]'"):
        prove(parse_procedure(many(12), "many.toml"))
    assert prove(load_procedure("subretinal_injection")).holds


def test_invariants_list_the_held_states_that_violate_them_and_remain_proved(procedure):
    states = tuple(
        replace(one, hold_ms=200.0 if one.name in ("retinal_contact", "outside_eye") else 0.0)
        for one in procedure.states
    )
    for prover in ("exhaustive", "z3"):
        proof = prove(replace(procedure, states=states), prover)
        assert proof.holds
        assert proof.held_ms == {"retinal_contact": 200.0, "outside_eye": 200.0}
        not_while_held = {
            claim.statement: claim.not_while_held for claim in proof.claims if claim.name == "invariant"
        }
        assert not_while_held["the alarm is felt at the retina only"] == ("retinal_contact",)
        assert not_while_held["touching the retina away from the target always feels the alarm"] == ()
        assert not_while_held["nothing vibrates when the tip is not seen"] == ()


def test_the_state_of_a_counterexample_does_not_depend_on_earlier_ones(procedure):
    states = tuple(replace(one, hold_ms=200.0) for one in procedure.states if one.name != "outside_eye")

    def violations(hold_ms):
        proof = prove(replace(procedure, states=tuple(replace(one, hold_ms=hold_ms) for one in states)))
        about_graphs = [one for one in proof.claims if one.name not in ("prompt", "consistent")]
        return [violation for claim in about_graphs for violation in claim.violations]

    assert violations(200.0) == violations(0.0) != []


def test_a_relation_counts_as_used_if_a_pattern_follows_its_measure():
    text = load_procedure("subretinal_injection_continuous").text
    text = text.replace("recorded_only = true", "recorded_only = false").replace(
        'measure = "distance_to_retina_mm"\nstart', 'measure = "distance_to_target_mm"\nstart'
    )
    assert prove(parse_procedure(text, "p.toml")).violations == []
    unused = text.replace(
        'measure = "distance_to_target_mm"\nstart', 'measure = "distance_to_retina_mm"\nstart'
    )
    (violation,) = prove(parse_procedure(unused, "p.toml")).violations
    assert "<needle_tip, approaching, retina_target> is used by no rule" in violation.sentence
