"""The decision to move, on every combination of its conditions."""

from itertools import product

import pytest

from haptigraph.robot.gate import HOLDS, LATCHED, NOT_LATCHING, Conditions, decide

NAMES = tuple(HOLDS)
ALL = Conditions(**dict.fromkeys(NAMES, True))
INTERRUPTIONS = [name for name in NAMES if name not in NOT_LATCHING]


def without(*names: str) -> Conditions:
    return Conditions(**{name: name not in names for name in NAMES})


def test_every_condition_has_its_reason():
    assert set(NAMES) == set(Conditions.__struct_fields__)
    assert len({*HOLDS.values(), LATCHED}) == len(NAMES) + 1
    assert set(NAMES) > NOT_LATCHING


def test_proof_over_all_conditions_and_latches():
    """Total, deterministic; moves only if everything holds; every hold names its reasons, and no other."""
    moving = 0
    for values in product((True, False), repeat=len(NAMES)):
        conditions = Conditions(*values)
        absent = tuple(HOLDS[name] for name, holds in zip(NAMES, values, strict=True) if not holds)
        for is_latched in (True, False):
            decision = decide(conditions, is_latched)
            moving += decision.moves
            latch_holds = (LATCHED,) if is_latched and conditions.is_switched_on else ()
            assert decision.reasons == absent + latch_holds
            assert decision.moves == (not absent and not is_latched)
            assert decision == decide(conditions, is_latched)
            # The latch is released by the switch alone, and set by every interruption while it is on.
            interrupted = any(
                not getattr(conditions, name) for name in INTERRUPTIONS if name != "is_leader_heard"
            )
            interrupted |= conditions.is_engaged and not conditions.is_leader_heard
            assert decision.is_latched == (conditions.is_switched_on and (is_latched or interrupted))
    assert moving == 1


@pytest.mark.parametrize("name", NAMES)
def test_every_condition_alone_holds(name):
    assert decide(without(name), is_latched=False).reasons == (HOLDS[name],)


@pytest.mark.parametrize("name", INTERRUPTIONS)
def test_after_an_interruption_motion_resumes_only_by_the_switch(name):
    is_latched = decide(without(name), is_latched=False).is_latched
    for _ in range(3):
        held = decide(ALL, is_latched)
        assert held.reasons == (LATCHED,)
        is_latched = held.is_latched
    is_latched = decide(without("is_switched_on"), is_latched).is_latched
    assert decide(ALL, is_latched).moves


@pytest.mark.parametrize("name", sorted(NOT_LATCHING))
def test_what_the_operator_does_needs_no_switch_to_resume(name):
    assert decide(ALL, decide(without(name), is_latched=False).is_latched).moves


def test_a_silent_leader_interrupts_only_a_hand_that_was_engaged():
    assert not decide(without("is_leader_heard", "is_engaged"), is_latched=False).is_latched
    assert decide(without("is_leader_heard"), is_latched=False).is_latched


def test_switching_on_during_an_interruption_does_not_start_motion_later():
    is_latched = decide(without("is_robot_ready"), is_latched=False).is_latched
    assert not decide(ALL, is_latched).moves
