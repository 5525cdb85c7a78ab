"""Broken procedures are found, each with a graph that really breaks the claim; sound ones are not refused."""

import pytest
from making import BREAKERS, break_it, load, sound

from haptigraph.assemble import load_procedure, procedure_names
from haptigraph.graph import SceneGraph
from haptigraph.inference.engine import RuleEngine
from haptigraph.inference.procedure import Procedure
from haptigraph.messages import UNKNOWN
from haptigraph.proof.prove import prove

SEEDS = range(12)


def holding(graph: SceneGraph) -> set[tuple[str, str, str]]:
    return {(edge.subject, edge.predicate, edge.object) for edge in graph.edges}


def fits(part, graph: SceneGraph) -> bool:
    """Whether the first part of a state or an invariant fits a graph, read as a person does."""
    there = {node.id for node in graph.nodes}
    return (
        all(names in holding(graph) for names in part.when)
        and not any(names in holding(graph) for names in part.unless)
        and all(name in there for name in getattr(part, "present", ()))
        and not any(name in there for name in part.absent)
    )


def can_be_seen(procedure: Procedure, graph: SceneGraph) -> bool:
    """Whether the example measures of a graph give its very edges, each held before or not."""
    schema, edges = procedure.schema, holding(graph)
    there = {node.id for node in graph.nodes}
    for relation in schema.relations:
        value = graph.measures.get(schema.measure_name(relation))
        given = all(names in edges for names in relation.given)
        if value is None or not {relation.subject, relation.object} <= there:
            must = may = False
        else:
            must = relation.holds(value) and given
            may = relation.holds(value, held=True) and given
        if (relation.names in edges and not may) or (relation.names not in edges and must):
            return False
    for entity in schema.entities:
        if entity.fixed and there and entity.name not in there:
            return False
        if entity.seen_with and (entity.name in there) != (entity.seen_with in there):
            return False
    return True


def really_breaks(procedure: Procedure, claim, violation) -> bool:
    """Judge a counterexample without the prover: by the rule engine and by reading."""
    graph = violation.graph
    if graph is None:  # a pattern or a gap that is not there has no graph
        kind, _, name = violation.about.partition(" ")
        return kind == "gap" or (kind == "pattern" and all(one.feel != name for one in procedure.states))
    if RuleEngine(procedure)(graph).state != violation.state:
        return False
    if not violation.is_possible:
        return not can_be_seen(procedure, graph) or not graph.measures
    if not can_be_seen(procedure, graph):
        return False
    name = violation.about.partition(" ")[2]
    state = next((one for one in procedure.states if one.name == name), None)
    invariant = next((one for one in procedure.invariants if one.name == name), None)
    relations = [relation for relation in procedure.schema.relations if relation.names in holding(graph)]
    if claim.name == "total":
        return violation.state == UNKNOWN and not any(fits(one, graph) for one in procedure.states)
    if claim.name == "reachable":
        return fits(state, graph) and violation.state != state.name
    if claim.name == "exclusive":
        measured = [procedure.schema.measure_name(relation) for relation in relations]
        return len(set(measured)) < len(measured)
    if claim.name == "gapless":
        measure = violation.about.partition(" ")[2]
        return measure in graph.measures and all(
            procedure.schema.measure_name(relation) != measure for relation in relations
        )
    if claim.name == "invariant":
        feel = RuleEngine(procedure)(graph).feel
        return fits(invariant, graph) and not invariant.allows(violation.state, feel)
    return claim.name == "used" and violation.about.split()[0] in ("relation", "entity")


def check_all(breaker, seeds) -> None:
    """Break a procedure of every seed; the defect is found, and whatever graph is shown breaks its claim."""
    for seed in seeds:
        procedure, expected = break_it(breaker, seed)
        proof = prove(procedure, "exhaustive")
        broken = [claim for claim in proof.claims if not claim.holds]
        assert {claim.name for claim in broken} & set(expected), (seed, expected)
        for claim in broken:
            for violation in claim.violations:
                assert really_breaks(procedure, claim, violation), (seed, claim.name, violation)


@pytest.mark.parametrize("breaker", BREAKERS, ids=lambda breaker: breaker.__name__)
def test_every_seeded_defect_is_found_with_a_graph_that_breaks_the_claim(breaker):
    check_all(breaker, SEEDS)


@pytest.mark.slow
@pytest.mark.parametrize("breaker", BREAKERS, ids=lambda breaker: breaker.__name__)
def test_every_defect_of_many_more_seeds_is_found(breaker):
    check_all(breaker, range(len(SEEDS), 150))


@pytest.mark.slow
def test_no_sound_procedure_of_many_more_is_refused():
    for seed in range(100, 2000):
        assert prove(load(sound(seed).data), "exhaustive").holds, seed


def test_the_suite_is_as_large_as_it_says():
    texts = {break_it(breaker, seed).procedure.text for breaker in BREAKERS for seed in SEEDS}
    assert len(texts) >= 200


def test_no_sound_procedure_is_refused():
    for seed in range(100):
        proof = prove(load(sound(seed).data), "exhaustive")
        assert proof.holds, (seed, proof.violations)


@pytest.mark.parametrize("name", procedure_names())
def test_what_ships_is_proved(name):
    assert prove(load_procedure(name)).violations == []
