"""The shipped procedures, broken in every way of a kind: each rule dropped, each touch changed, each lifted over others."""

import pytest
from msgspec.structs import replace

from haptigraph.assemble import load_procedure, procedure_names
from haptigraph.messages import UNKNOWN
from haptigraph.proof.prove import prove
from haptigraph.proof.rules import cubes_of
from haptigraph.proof.space import Space

SHIPPED = [load_procedure(name) for name in procedure_names()]


@pytest.fixture(params=SHIPPED, ids=lambda one: one.name)
def shipped(request):
    return request.param


def test_without_any_of_its_rules_it_is_refused(shipped):
    for at, state in enumerate(shipped.states):
        if state.name != UNKNOWN:
            left = shipped.states[:at] + shipped.states[at + 1 :]
            assert not prove(replace(shipped, states=left)).holds, state.name


def test_with_any_other_touch_in_any_state_it_is_refused(shipped):
    for at, state in enumerate(shipped.states):
        for pattern in shipped.patterns:
            if pattern.name != state.feel:
                other = replace(state, feel=pattern.name)
                states = (*shipped.states[:at], other, *shipped.states[at + 1 :])
                assert not prove(replace(shipped, states=states)).holds, (state.name, pattern.name)


def test_any_rule_lifted_to_any_place_is_refused_just_where_that_changes_what_happens(shipped):
    """Rules that no possible graph fits both can change places without effect: that is no defect."""
    space = Space(shipped.schema)
    rules = cubes_of(shipped, space)
    masks = [world.mask for world in space.worlds()]

    def outcome(order: list[int], mask: int) -> int | None:
        return next((rule for rule in order if rules[rule].fits(mask)), None)

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
