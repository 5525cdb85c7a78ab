"""Mutated procedures are refused, each with a valid counterexample; sound ones are accepted."""

import pytest
from making import MUTATIONS, load, mutate, sound

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
    """Whether the condition of a state or an invariant matches a graph, by a direct reading."""
    nodes = {node.id for node in graph.nodes}
    return (
        all(names in holding(graph) for names in part.when)
        and not any(names in holding(graph) for names in part.unless)
        and all(name in nodes for name in getattr(part, "present", ()))
        and not any(name in nodes for name in part.absent)
    )


def is_possible(procedure: Procedure, graph: SceneGraph) -> bool:
    """Whether the example measures of a graph produce exactly its edges, whether or not each held before."""
    schema, edges = procedure.schema, holding(graph)
    nodes = {node.id for node in graph.nodes}
    for relation in schema.relations:
        value = graph.measures.get(schema.measure_name(relation))
        given = all(names in edges for names in relation.given)
        if value is None or not {relation.subject, relation.object} <= nodes:
            must = may = False
        else:
            must = relation.holds(value) and given
            may = relation.holds(value, held=True) and given
        if (relation.names in edges and not may) or (relation.names not in edges and must):
            return False
    for entity in schema.entities:
        if entity.fixed and nodes and entity.name not in nodes:
            return False
        if entity.visible_with and (entity.name in nodes) != (entity.visible_with in nodes):
            return False
        if entity.only_with and entity.name in nodes and entity.only_with not in nodes:
            return False
    return True


def is_valid(procedure: Procedure, claim, violation) -> bool:
    """Check a counterexample without the prover: with the rule engine and by a direct reading."""
    graph = violation.graph
    if graph is None:  # an unused pattern or a needless gap has no graph
        kind, _, name = violation.about.partition(" ")
        return kind == "gap" or (kind == "pattern" and all(one.feel != name for one in procedure.states))
    if RuleEngine(procedure)(graph).state != violation.state:
        return False
    if not violation.is_possible:
        return not is_possible(procedure, graph) or not graph.measures
    if not is_possible(procedure, graph):
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
        concluded = RuleEngine(procedure)(graph)
        allowed = invariant.allows(violation.state, concluded.feel, concluded.forces)
        return fits(invariant, graph) and not allowed
    return claim.name == "used" and violation.about.split()[0] in ("relation", "entity")


def check_all(mutation, seeds) -> None:
    """For every seed, check that the mutation is detected and that every counterexample is valid."""
    for seed in seeds:
        procedure, expected = mutate(mutation, seed)
        proof = prove(procedure, "exhaustive")
        violated = [claim for claim in proof.claims if not claim.holds]
        assert {claim.name for claim in violated} & set(expected), (seed, expected)
        for claim in violated:
            for violation in claim.violations:
                assert is_valid(procedure, claim, violation), (seed, claim.name, violation)


@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda mutation: mutation.__name__)
def test_every_mutation_is_detected_with_a_valid_counterexample(mutation):
    check_all(mutation, SEEDS)


@pytest.mark.slow
@pytest.mark.parametrize("mutation", MUTATIONS, ids=lambda mutation: mutation.__name__)
def test_every_mutation_is_detected_for_many_more_seeds(mutation):
    check_all(mutation, range(len(SEEDS), 150))


@pytest.mark.slow
def test_many_more_sound_procedures_are_accepted():
    for seed in range(100, 2000):
        assert prove(load(sound(seed).data), "exhaustive").holds, seed


def test_the_suite_has_at_least_200_different_mutants():
    texts = {mutate(mutation, seed).procedure.text for mutation in MUTATIONS for seed in SEEDS}
    assert len(texts) >= 200


def test_sound_procedures_are_accepted():
    for seed in range(100):
        proof = prove(load(sound(seed).data), "exhaustive")
        assert proof.holds, (seed, proof.violations)


@pytest.mark.parametrize("name", procedure_names())
def test_shipped_procedures_are_proved(name):
    assert prove(load_procedure(name)).violations == []
