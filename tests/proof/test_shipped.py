"""All mutants of the shipped procedures of three kinds: a rule removed, a pattern changed, a rule moved up."""

import pytest
from helpers import mostly_slow
from msgspec.structs import replace

from haptigraph.assemble import load_procedure, procedure_names
from haptigraph.messages import UNKNOWN
from haptigraph.proof.prove import prove
from haptigraph.proof.rules import rule_cubes
from haptigraph.proof.space import Space

SHIPPED = mostly_slow([load_procedure(name) for name in procedure_names()], "vein_cannulation")


@pytest.fixture(params=SHIPPED, ids=lambda one: one.name)
def shipped(request):
    return request.param


def test_a_procedure_that_lacks_a_rule_is_refused(shipped):
    for at, state in enumerate(shipped.states):
        if state.name != UNKNOWN:
            others = shipped.states[:at] + shipped.states[at + 1 :]
            assert not prove(replace(shipped, states=others)).holds, state.name


def test_a_procedure_with_another_pattern_in_a_state_is_refused(shipped):
    for at, state in enumerate(shipped.states):
        for pattern in shipped.patterns:
            if pattern.name != state.feel:
                other = replace(state, feel=pattern.name)
                states = (*shipped.states[:at], other, *shipped.states[at + 1 :])
                assert not prove(replace(shipped, states=states)).holds, (state.name, pattern.name)


def test_a_rule_of_higher_priority_is_refused_exactly_if_that_changes_a_state(shipped):
    """Rules that never match the same graph can be swapped without effect: that is not a defect."""
    shipped = replace(shipped, states=tuple(replace(state, hold_ms=0.0) for state in shipped.states))
    space = Space(shipped.schema)
    rules = rule_cubes(shipped, space)
    masks = [world.mask for world in space.worlds()]

    def outcome(order: list[int], mask: int) -> int | None:
        return next((rule for rule in order if rules[rule].matches(mask)), None)

    plain = list(range(len(rules)))
    refused = 0
    for low in plain:
        for high in range(low):
            order = [*plain[:high], low, *(rule for rule in plain[high:] if rule != low)]
            changes = any(outcome(order, mask) != outcome(plain, mask) for mask in masks)
            holds = prove(replace(shipped, states=tuple(shipped.states[rule] for rule in order))).holds
            assert holds != changes, (shipped.states[low].name, shipped.states[high].name)
            refused += changes
    assert refused > 0
